// The missions of a campaign: sorted, filtered, and the command that flies one again.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("data").textContent);
  const PAGE = 200; // rows that are shown at first, and more each time
  const floats = (one) => new Float32Array(Uint8Array.from(atob(one.f4), (letter) => letter.charCodeAt(0)).buffer);
  const columns = data.columns.map((one) => ({ values: one.values, of: floats(one.of) }));
  const figures = data.figures.map(floats);
  const cells = floats(data.cells);
  const count = data.seeds.length;
  const labels = data.labels.length;
  const headings = [...data.labels, "seed", ...data.headings];
  const state = { column: null, down: false, shown: PAGE, chosen: columns.map(() => ""), text: "" };

  function element(tag, text, parent) {
    const made = document.createElement(tag);
    if (text !== null) made.textContent = text;
    parent.append(made);
    return made;
  }

  const said = (value) => (value === null ? "–" : String(value));
  const label = (k, row) => columns[k].values[columns[k].of[row]];
  const number = (value) => (!Number.isFinite(value) ? "–" : value.toPrecision(4));

  function value(column, row) {
    if (column < labels) return label(column, row);
    return column === labels ? data.seeds[row] : figures[column - labels - 1][row];
  }

  function compare(a, b) {
    const missing = (x) => x === null || Number.isNaN(x);
    if (missing(a) || missing(b)) return missing(a) - missing(b);
    const order = a < b ? -1 : a > b ? 1 : 0;
    return state.down ? -order : order;
  }

  function chosen_rows() {
    const words = state.text.toLowerCase().split(/\s+/).filter((word) => word);
    const rows = [];
    for (let row = 0; row < count; row += 1) {
      if (!state.chosen.every((one, k) => one === "" || columns[k].of[row] === Number(one))) continue;
      const text = [...columns.map((_, k) => said(label(k, row))), `seed ${data.seeds[row]}`, data.errors[row] ? `failed ${data.errors[row]}` : ""].join(" ").toLowerCase();
      if (words.every((word) => text.includes(word))) rows.push(row);
    }
    if (state.column !== null) rows.sort((a, b) => compare(value(state.column, a), value(state.column, b)) || a - b);
    return rows;
  }

  function show() {
    const rows = chosen_rows();
    const body = $("missions").tBodies[0];
    body.replaceChildren();
    for (const row of rows.slice(0, state.shown)) add_row(body, row);
    const failed = rows.filter((row) => data.errors[row]).length;
    $("count").textContent = `${rows.length} of ${count} missions, ${failed} of them failed; ${Math.min(rows.length, state.shown)} are shown.`;
    $("more").hidden = rows.length <= state.shown;
    show_medians(rows);
  }

  function add_row(body, row) {
    const made = element("tr", null, body);
    columns.forEach((_, k) => { element("td", said(label(k, row)), made).title = said(label(k, row)); });
    element("td", data.seeds[row], made);
    if (data.errors[row]) {
      const why = element("td", `failed: ${data.errors[row]}`, made);
      why.colSpan = figures.length;
      why.className = "words broken";
    } else {
      for (const figure of figures) element("td", number(figure[row]), made);
    }
    const button = element("button", "Fly again", element("td", null, made));
    button.addEventListener("click", () => tell_command(row));
  }

  const median = (values) => {
    const known = values.filter(Number.isFinite).sort((a, b) => a - b), half = known.length >> 1;
    if (!known.length) return NaN;
    return known.length % 2 ? known[half] : (known[half - 1] + known[half]) / 2;
  };

  function show_medians(rows) {
    const body = $("summary").tBodies[0];
    body.replaceChildren();
    columns[1].values.forEach((planner, k) => {
      const own = rows.filter((row) => columns[1].of[row] === k);
      if (!own.length) return;
      const made = element("tr", null, body);
      element("td", said(planner), made);
      element("td", own.length, made);
      for (const figure of figures) element("td", number(median(own.map((row) => figure[row]))), made);
    });
  }

  const quoted = (word) => (/^[\w./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

  function tell_command(row) {
    $("again").hidden = false;
    $("which").textContent = `${said(label(0, row))}, ${said(label(1, row))}, seed ${data.seeds[row]}`;
    $("command").textContent = `obsplan report ${quoted(data.folder)} --mission ${cells[row]}/${data.seeds[row]} --open`;
    $("again").scrollIntoView({ block: "nearest" });
    $("copy").focus();
  }

  function copy() {
    const range = document.createRange();
    range.selectNodeContents($("command"));
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    const done = document.execCommand("copy"); // where there is no clipboard the text is selected
    $("copy").textContent = done ? "Copied" : "Selected: press Ctrl+C";
  }

  function sort_by(column) {
    state.down = state.column === column ? !state.down : false;
    state.column = column;
    [...$("missions").tHead.rows[0].cells].forEach((cell, k) => {
      if (k === column) cell.setAttribute("aria-sort", state.down ? "descending" : "ascending"); else cell.removeAttribute("aria-sort");
      const button = cell.querySelector("button");
      if (button) button.textContent = headings[k] + (k === column ? (state.down ? " ▼" : " ▲") : "");
    });
    show();
  }

  function begin() {
    $("title").textContent = data.title;
    $("about").textContent = "A heading sorts by its column, and again the other way. Medians are of the missions that the filters leave."
      + (data.left_out ? ` ${data.left_out} more missions are in campaign.csv.` : "");
    const head = element("tr", null, element("thead", null, $("missions")));
    headings.forEach((heading, k) => {
      const cell = element("th", null, head);
      cell.scope = "col";
      element("button", heading, cell).addEventListener("click", () => sort_by(k));
    });
    element("th", "", head);
    element("tbody", null, $("missions"));
    const means = element("tr", null, element("thead", null, $("summary")));
    for (const text of ["planner", "missions", ...data.headings.map((one) => `median ${one}`)]) element("th", text, means).scope = "col";
    element("tbody", null, $("summary"));
    columns.forEach((one, k) => {
      if (one.values.length < 2) return;
      const select = element("select", null, element("label", `${data.labels[k]} `, $("filters")));
      element("option", "all", select).value = "";
      one.values.forEach((text, j) => { element("option", said(text), select).value = j; });
      select.addEventListener("change", () => { state.chosen[k] = select.value; show(); });
    });
    const search = element("input", null, element("label", "Words ", $("filters")));
    search.type = "search";
    search.addEventListener("input", () => { state.text = search.value; show(); });
    $("more").addEventListener("click", () => { state.shown += 5 * PAGE; show(); });
    $("copy").addEventListener("click", copy);
    $("close").addEventListener("click", () => { $("again").hidden = true; });
    show();
    document.documentElement.dataset.ready = "yes";
  }

  begin();
})();
