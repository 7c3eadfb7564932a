// Plays the missions of one page: maps and panels drawn by Bokeh, all at the same time.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const data = unpack(JSON.parse($("data").textContent));
  const scenes = data.scenes;
  const end = Math.max(...scenes.map((scene) => scene.time[scene.time.length - 1]));
  const [unit, length] = data.unit; // symbol, and its seconds
  const SPEEDS = [1, 2, 5, 10, 20, 50, 100];
  const TRAIL = 300; // seconds of a track that are drawn strong
  const AHEAD = 300; // seconds of a planned path that are drawn
  const HELD = 30; // seconds for which an aid vehicle's present command is drawn on, where no path is known
  const CHART = 0.5; // opacity of a chart's picture
  const state = { t: 0, playing: false, speed: 1, auv: 0 };
  const maps = [];
  const panels = [];
  const themed = []; // what is painted again when light turns dark

  function unpack(value) {
    if (Array.isArray(value)) return value.map(unpack);
    if (value === null || typeof value !== "object") return value;
    for (const kind of ["f4", "u1"]) {
      if (typeof value[kind] !== "string") continue;
      const bytes = Uint8Array.from(atob(value[kind]), (letter) => letter.charCodeAt(0));
      return kind === "u1" ? bytes : new Float32Array(bytes.buffer);
    }
    return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, unpack(one)]));
  }

  function element(tag, text, parent, className) {
    const made = document.createElement(tag);
    if (text !== null) made.textContent = text;
    if (className) made.className = className;
    parent.append(made);
    return made;
  }

  // Last index whose time is not after t, at least 0.
  function newest(times, t) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t + 1e-4) low = middle + 1; else high = middle;
    }
    return Math.max(low - 1, 0);
  }

  // ---- colours -------------------------------------------------------------------------------
  const dark = matchMedia("(prefers-color-scheme: dark)");

  // A named colour of the page, or a vehicle's, lighter on dark.
  function paint(name) {
    if (!name.startsWith("#")) return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    if (!dark.matches) return name;
    const parts = [1, 3, 5].map((k) => parseInt(name.slice(k, k + 2), 16));
    return "#" + parts.map((part) => Math.round(part + 0.4 * (255 - part)).toString(16).padStart(2, "0")).join("");
  }

  function follow_theme(paint_it) {
    themed.push(paint_it);
    paint_it();
  }

  function dress(figure) {
    follow_theme(() => {
      figure.background_fill_color = paint("plot");
      figure.border_fill_color = paint("page");
      figure.outline_line_color = paint("edge");
      for (const axis of [...figure.below, ...figure.left]) {
        axis.axis_label_text_color = axis.major_label_text_color = paint("ink");
        axis.axis_line_color = axis.major_tick_line_color = paint("edge");
      }
      for (const grid of figure.center) grid.grid_line_color = paint("grid");
    });
    for (const axis of [...figure.below, ...figure.left]) {
      axis.axis_label_text_font_style = "normal";
      axis.minor_tick_line_color = null;
      axis.axis_label_text_font_size = axis.major_label_text_font_size = "12px";
    }
  }

  // A glyph whose line and fill have one colour, which follows the theme.
  function coloured(renderer, name, fill) {
    follow_theme(() => {
      const colour = paint(name);
      if ("line_color" in renderer.glyph.properties) renderer.glyph.line_color = colour;
      if (fill && "fill_color" in renderer.glyph.properties) renderer.glyph.fill_color = colour;
      if ("text_color" in renderer.glyph.properties) renderer.glyph.text_color = colour;
    });
    return renderer;
  }

  const source = (columns) => new Bokeh.ColumnDataSource({ data: columns });
  const f = (field) => ({ field });

  // ---- map -----------------------------------------------------------------------------------
  const view = { x: new Bokeh.Range1d({ start: 0, end: 1 }), y: new Bokeh.Range1d({ start: 0, end: 1 }) };

  function make_map(scene) {
    const box = element("div", null, $("maps"), "map");
    if (scenes.length > 1) element("h3", scene.label, box);
    const target = element("div", null, box, "plot");
    const figure = Bokeh.Plotting.figure({
      x_range: view.x, y_range: view.y, sizing_mode: "stretch_both", tools: "pan,wheel_zoom",
      toolbar_location: null, x_axis_label: data.axes[0], y_axis_label: data.axes[1],
      min_border_right: 12, lod_threshold: null,
    });
    dress(figure);
    const map = { scene, figure, target, whole: [] };
    draw_chart(figure, scene);
    draw_fixed(map);
    add_moving(map);
    figure.add_tools(new Bokeh.HoverTool({ renderers: map.hovered, tooltips: [["", "@who"], ["", "@what"]] }));
    figure.on_event("mousemove", (event) => tell_place(event.x, event.y));
    return map;
  }

  // Under everything else, and so faint that tracks are read on light and on dark.
  function draw_chart(figure) {
    for (const { url, x, y, w, h } of data.pictures || []) {
      const place = source({ url: [url], x: [x], y: [y], w: [w], h: [h] });
      const look = { source: place, anchor: "bottom_left", global_alpha: CHART, level: "image" };
      figure.image_url(f("url"), f("x"), f("y"), f("w"), f("h"), look);
    }
    for (const line of data.chart || []) {
      const drawn = figure.line({ field: "x" }, { field: "y" }, { source: source(line), line_width: 1.5, line_alpha: 0.7 });
      coloured(drawn, "faint");
    }
  }

  function draw_fixed(map) {
    const { figure, scene } = map;
    for (const area of scene.areas) {
      const outline = source({ x: area.x, y: area.y });
      if (area.keep_out) {
        const look = { source: outline, fill_alpha: 0.08, line_width: 1, hatch_pattern: "/", hatch_alpha: 0.35, hatch_scale: 9 };
        const drawn = coloured(figure.patch(f("x"), f("y"), look), "limit", true);
        follow_theme(() => { drawn.glyph.hatch_color = paint("limit"); });
      } else {
        coloured(figure.line(f("x"), f("y"), { source: outline, line_width: 1.5, line_dash: "dashdot" }), "limit");
      }
    }
    for (const plan of scene.plans) {
      coloured(figure.line(f("x"), f("y"), { source: source(plan), line_dash: [5, 4], line_width: 1 }), "faint");
    }
    for (const vehicle of [...scene.auvs, ...scene.aids]) {
      const look = { source: source(vehicle.track), line_width: 1.2, line_alpha: 0.45 };
      map.whole.push(coloured(figure.line(f("x"), f("y"), look), vehicle.colour || "ink"));
      if (!vehicle.smoothed) continue;
      const smooth = { source: source(vehicle.smoothed), line_width: 1.2, line_dash: "dotted", line_alpha: 0.9 };
      map.whole.push(coloured(figure.line(f("x"), f("y"), smooth), vehicle.colour));
    }
    const [x, y] = [0, 1].map((k) => scene.moored.map((place) => place[k]));
    const look = { source: source({ x, y }), size: 11, marker: "triangle", fill_alpha: 0, line_width: 2 };
    coloured(figure.scatter(f("x"), f("y"), look), "ink");
  }

  // What changes with time, each with the source that is given new data.
  function add_moving(map) {
    const { figure } = map;
    const add = (name, columns, draw) => {
      map[name] = source(Object.fromEntries(columns.map((column) => [column, []])));
      const renderer = draw(map[name]);
      renderer.level = "overlay"; // on a canvas of its own: what does not move is not painted again
      return renderer;
    };
    add("trails", ["xs", "ys", "colour"], (s) =>
      figure.multi_line(f("xs"), f("ys"), { source: s, line_color: f("colour"), line_width: 2.2 }));
    add("rings", ["x", "y", "radius"], (s) => coloured(figure.circle(f("x"), f("y"), f("radius"),
      { source: s, fill_alpha: 0, line_dash: "dotted", line_width: 1.2 }), "limit"));
    add("ahead", ["x", "y"], (s) => coloured(figure.line(f("x"), f("y"),
      { source: s, line_dash: [2, 3], line_width: 2 }), "ink"));
    const pings = add("pings", ["x0", "y0", "x1", "y1", "colour", "dash"], (s) => figure.segment(f("x0"), f("y0"), f("x1"), f("y1"),
      { source: s, line_color: f("colour"), line_dash: f("dash"), line_width: 2 }));
    const ellipses = add("ellipses", ["x", "y", "width", "height", "angle", "colour"], (s) => figure.ellipse(
      f("x"), f("y"), f("width"), f("height"),
      { source: s, angle: f("angle"), fill_color: f("colour"), line_color: f("colour"), fill_alpha: 0.2, line_width: 1.2 }));
    const estimates = add("estimates", ["x", "y", "colour"], (s) => figure.scatter(f("x"), f("y"),
      { source: s, marker: "cross", size: 13, line_color: f("colour"), line_width: 2.5 }));
    const look = { marker: "triangle", size: 14, angle: f("angle"), fill_color: f("colour"), line_width: 1.5 };
    const vehicles = add("vehicles", ["x", "y", "angle", "colour"], (s) => figure.scatter(f("x"), f("y"), { source: s, ...look }));
    const labels = add("labels", ["x", "y", "text", "colour"], (s) => figure.text(f("x"), f("y"), f("text"),
      { source: s, text_color: f("colour"), text_font_size: "12px", text_font_style: "bold", x_offset: 6, y_offset: -6, text_outline_color: paint("plot") }));
    follow_theme(() => {
      vehicles.glyph.line_color = paint("plot");
      labels.glyph.text_outline_color = paint("plot");
    });
    map.hovered = [vehicles, estimates, ellipses, pings];
  }

  function update_map(map) {
    const { scene } = map;
    const k = map.frame = newest(scene.time, state.t);
    const first = newest(scene.time, state.t - TRAIL);
    const auvs = scene.auvs, all = [...auvs, ...scene.aids];
    const now = (rows, name) => rows.map((row) => row[name][k]);
    const colours = all.map((row) => paint(row.colour || "ink"));
    map.trails.data = { xs: all.map((row) => row.x.subarray(first, k + 1)), ys: all.map((row) => row.y.subarray(first, k + 1)), colour: colours };
    const seen = [...auvs.filter((row) => row.known), ...scene.aids];
    map.vehicles.data = {
      x: now(seen, "x"), y: now(seen, "y"), angle: seen.map((row) => row.heading[k] - Math.PI / 2),
      colour: seen.map((row) => paint(row.colour || "ink")), who: seen.map((row) => row.name),
      what: seen.map((row) => `${place_words(row.x[k], row.y[k])}`),
    };
    const own = colours.slice(0, auvs.length), who = auvs.map((row) => `${row.name}, estimated`);
    const sure = auvs.map((row) => `95 % within ${metres(row.major[k])} × ${metres(row.minor[k])}`);
    map.estimates.data = { x: now(auvs, "est_x"), y: now(auvs, "est_y"), colour: own, who, what: sure };
    map.ellipses.data = {
      x: now(auvs, "est_x"), y: now(auvs, "est_y"), width: auvs.map((row) => 2 * row.major[k]),
      height: auvs.map((row) => 2 * row.minor[k]), angle: now(auvs, "angle"), colour: own, who, what: sure,
    };
    const rings = scene.rings.flatMap((ring) => auvs.map((row) => [row.x[k], row.y[k], ring.radius]));
    map.rings.data = { x: rings.map((r) => r[0]), y: rings.map((r) => r[1]), radius: rings.map((r) => r[2]) };
    map.ahead.data = ahead(scene, k);
    update_pings(map, auvs);
  }

  // Where each aid vehicle is to go from here, as planned by now, with gaps between them.
  function ahead(scene, k) {
    const x = [], y = [];
    for (const aid of scene.aids) {
      const [east, north] = planned(scene, aid, k) || held(aid, k);
      x.push(aid.x[k], ...east, NaN);
      y.push(aid.y[k], ...north, NaN);
    }
    return { x, y };
  }

  // The rest of the path that the planner had in mind; null where none is known.
  function planned(scene, aid, k) {
    const plan = aid.planned;
    if (!plan) return null;
    if (plan.flown) {
      const last = newest(scene.time, state.t + AHEAD) + 1;
      return [aid.x.subarray(k + 1, last), aid.y.subarray(k + 1, last)];
    }
    const j = newest(plan.decided, state.t);
    const begin = j ? plan.ends[j - 1] : 0, end_ = plan.ends[j];
    const times = plan.t.subarray(begin, end_);
    if (state.t < plan.decided[j] - 1e-4 || times[times.length - 1] <= scene.time[k]) return null;
    const first = begin + newest(times, scene.time[k]) + (times[0] <= scene.time[k] + 1e-4 ? 1 : 0);
    const last = begin + newest(times, scene.time[k] + AHEAD) + 1;
    return [plan.x.subarray(first, last), plan.y.subarray(first, last)];
  }

  // The course on which the present command keeps an aid vehicle, were it held.
  function held(aid, k) {
    const x = [], y = [], turn = aid.turn[k], speed = aid.speed[k];
    if (!Number.isFinite(turn) || !(speed > 0)) return [x, y];
    let [east, north, heading] = [aid.x[k], aid.y[k], aid.heading[k]];
    for (let s = 0; s < HELD; s += 1) {
      east += speed * Math.cos(heading + turn / 2);
      north += speed * Math.sin(heading + turn / 2);
      heading += turn;
      x.push(east);
      y.push(north);
    }
    return [x, y];
  }

  // The newest range of each pair, as long as it is shown, and of each AUV the newest of all.
  function update_pings(map, auvs) {
    const { pings, shown } = map.scene, c = pings.columns;
    const columns = { x0: [], y0: [], x1: [], y1: [], colour: [], dash: [], who: [], what: [] };
    const labels = { x: [], y: [], text: [], colour: [] };
    const pairs = new Set();
    map.shown = [];
    for (let j = newest(c.t, state.t); j >= 0 && c.t[j] > state.t - shown; j -= 1) {
      const pair = `${c.auv[j]},${c.beacon[j]}`;
      if (c.t[j] > state.t + 1e-4 || pairs.has(pair)) continue;
      pairs.add(pair);
      map.shown.push(j);
      const taken = pings.taken.includes(c.fate[j]), colour = taken ? paint(auvs[c.auv[j]].colour) : paint("broken");
      for (const end_ of ["x0", "y0", "x1", "y1"]) columns[end_].push(c[end_][j]);
      columns.colour.push(colour);
      columns.dash.push(taken ? "solid" : "dashed");
      columns.who.push(`${auvs[c.auv[j]].name} to ${pings.beacons[c.beacon[j]]}`);
      columns.what.push(ping_words(pings, j));
      const along = 0.25 + 0.2 * (c.auv[j] % 3); // labels of AUVs that are close together stand apart
      labels.x.push(c.x0[j] + along * (c.x1[j] - c.x0[j]));
      labels.y.push(c.y0[j] + along * (c.y1[j] - c.y0[j]));
      labels.text.push(taken ? `${c.value[j].toFixed(1)} ${pings.unit}` : `✗ ${pings.words[c.fate[j]]}`);
      labels.colour.push(colour);
    }
    map.pings.data = columns;
    map.labels.data = labels;
  }

  function ping_words(pings, j) {
    const c = pings.columns, value = Number.isFinite(c.value[j]) ? `${c.value[j].toFixed(2)} ${pings.unit}` : "";
    const expected = Number.isFinite(c.expected[j]) ? `expected ${c.expected[j].toFixed(2)} ± ${c.sigma[j].toFixed(2)}` : "";
    return [value, expected, pings.words[c.fate[j]]].filter((part) => part).join(", ");
  }

  // ---- panels --------------------------------------------------------------------------------
  const times = new Bokeh.Range1d({ start: 0, end: end / length, bounds: "auto" });

  function make_panel(panel) {
    const box = element("div", null, $("panels"), "panel");
    element("h3", panel.title, box);
    const key = element("ul", null, box, "legend");
    const target = element("div", null, box, "plot");
    const y_range = panel.ranges ? new Bokeh.Range1d({ start: 0, end: 1 }) : new Bokeh.DataRange1d();
    const figure = Bokeh.Plotting.figure({
      x_range: times, y_range, y_axis_type: panel.log ? "log" : "linear", sizing_mode: "stretch_both", tools: "xpan,xwheel_zoom",
      toolbar_location: null, min_border_left: 56, min_border_right: 12, x_axis_label: `Time [${unit}]`, lod_threshold: null,
    });
    figure.toolbar.active_drag = null;
    figure.toolbar.active_scroll = null;
    dress(figure);
    const cursor = new Bokeh.Span({ location: 0, dimension: "height", line_width: 2, level: "overlay" });
    follow_theme(() => { cursor.line_color = paint("ink"); });
    const choices = panel.choices.map((series) => series.map((one) => draw_series(figure, one)));
    figure.add_layout(cursor);
    const lines = choices.flat().filter((renderer) => renderer.tooltipped);
    const tooltips = [["", "$name"], [`time [${unit}]`, "$snap_x{0.00}"], ["value", "$snap_y{0.000}"], ["", "@words"]];
    figure.add_tools(new Bokeh.HoverTool({ renderers: lines, tooltips: tooltips.slice(0, panel.choices.flat().some((one) => one.words) ? 4 : 3), mode: "mouse" }));
    figure.on_event("tap", (event) => seek(event.x * length));
    return { panel, figure, cursor, choices, y_range, key, target };
  }

  function draw_series(figure, one) {
    if (one.kind === "level" || one.kind === "span") return draw_level(figure, one);
    const columns = source(one.kind === "band" ? { t: one.t, low: one.low, y: one.y }
      : { t: one.t, y: one.y, ...(one.words && one.words.length ? { words: one.words } : {}) });
    const more = { source: columns, name: one.name };
    let renderer;
    if (one.kind === "band") {
      renderer = figure.varea(f("t"), f("low"), f("y"), { ...more, fill_alpha: 0.22 });
    } else if (one.kind === "dots") {
      const look = one.cross ? { marker: "x", size: 7, line_width: 1.8 } : { marker: "circle", size: 4 };
      renderer = figure.scatter(f("t"), f("y"), { ...more, ...look });
    } else {
      renderer = figure.line(f("t"), f("y"), { ...more, line_width: 1.3, line_dash: one.dash ? [5, 3] : "solid" });
    }
    renderer.tooltipped = one.kind !== "band";
    return coloured(renderer, one.colour, true);
  }

  function draw_level(figure, one) {
    const made = one.kind === "level" ? new Bokeh.Span({ location: one.at, dimension: "width", line_width: 1.2, line_dash: "dotted" })
      : new Bokeh.BoxAnnotation({ top: one.high, bottom: one.low, fill_alpha: 0.15, line_alpha: 0, level: "underlay" });
    figure.add_layout(made);
    follow_theme(() => { made.line_color = paint("limit"); if (one.kind === "span") made.fill_color = paint("faint"); });
    return made;
  }

  // Show the panels of an AUV: what is visible, its scale, its key.
  function choose(auv) {
    state.auv = auv;
    for (const { panel, choices, y_range, key } of panels) {
      const chosen = Math.min(auv, choices.length - 1);
      choices.forEach((renderers, k) => renderers.forEach((renderer) => { renderer.visible = k === chosen; }));
      if (panel.ranges) [y_range.start, y_range.end] = panel.ranges[Math.min(chosen, panel.ranges.length - 1)];
      key.replaceChildren();
      for (const one of panel.choices[chosen]) {
        add_key(key, one.name, one.kind, one.colour || (one.kind === "level" ? "limit" : "faint"), one.dash, one.cross);
      }
    }
    show_time();
  }

  function add_key(list, name, kind, colour, dash, cross) {
    const item = element("li", null, list);
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("width", 22);
    svg.setAttribute("height", 12);
    svg.setAttribute("class", "swatch");
    svg.setAttribute("aria-hidden", "true");
    const shapes = {
      band: '<rect width="22" height="12" opacity="0.3" fill="C"/>', span: '<rect width="22" height="12" opacity="0.3" fill="C"/>',
      dots: cross ? '<path d="M7 2l8 8M15 2l-8 8" stroke="C" stroke-width="2"/>' : '<circle cx="11" cy="6" r="3" fill="C"/>',
      line: '<path d="M0 6H22" stroke="C" stroke-width="2"/>', level: '<path d="M0 6H22" stroke="C" stroke-width="2" stroke-dasharray="2 3"/>',
      vehicle: '<path d="M11 1l6 10H5z" fill="C"/>', cross: '<path d="M11 0V12M5 6H17" stroke="C" stroke-width="2.5"/>',
      ellipse: '<ellipse cx="11" cy="6" rx="10" ry="5" fill="C" fill-opacity="0.25" stroke="C"/>',
      dashed: '<path d="M0 6H22" stroke="C" stroke-width="2" stroke-dasharray="5 3"/>',
    };
    follow_theme(() => { svg.innerHTML = shapes[dash ? "dashed" : kind].replaceAll("C\"", `${paint(colour)}"`); });
    item.append(svg, name);
  }

  // The colours of a chart's numbers, from low to high.
  function add_shades(list, { colours, text }) {
    const item = element("li", null, list);
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    const width = 6;
    svg.setAttribute("width", width * colours.length);
    svg.setAttribute("height", 12);
    svg.setAttribute("class", "swatch");
    svg.setAttribute("aria-hidden", "true");
    svg.innerHTML = colours.map((one, k) => `<rect x="${width * k}" width="${width}" height="12" opacity="${CHART}" fill="${one}"/>`).join("");
    item.append(svg, text);
  }

  // ---- what is said --------------------------------------------------------------------------
  const metres = (value) => !Number.isFinite(value) ? "–" : `${value.toFixed(value < 10 ? 2 : value < 100 ? 1 : 0)} m`;
  const clock = (t) => {
    const [h, m, s] = [Math.floor(t / 3600), Math.floor(t / 60) % 60, t % 60];
    return `${String(h).padStart(2, "0")}:${String(m).padStart(2, "0")}:${s.toFixed(1).padStart(4, "0")}`;
  };

  function place_words(x, y) {
    const local = `${x.toFixed(1)} m E, ${y.toFixed(1)} m N`;
    if (!data.origin) return local;
    const [lat, lon] = geographic(x, y);
    return `${local}; ${Math.abs(lat).toFixed(6)}° ${lat < 0 ? "S" : "N"}, ${Math.abs(lon).toFixed(6)}° ${lon < 0 ? "W" : "E"}`;
  }

  // Latitude and longitude [degrees, WGS 84] of a place in the plane tangent at the origin, lowered to altitude 0.
  function geographic(east, north) {
    const a = 6378137, e2 = 6.69437999014e-3, radians = Math.PI / 180;
    const [lat0, lon0] = [data.origin[0] * radians, data.origin[1] * radians];
    const [sin, cos] = [Math.sin(lat0), Math.cos(lat0)], n0 = a / Math.sqrt(1 - e2 * sin * sin);
    let up = 0, lat = lat0, lon = lon0;
    for (let pass = 0; pass < 3; pass += 1) {
      const out = (n0 + up) * cos - north * sin; // from the axis, in the origin's meridian
      const z = (n0 * (1 - e2) + up) * sin + north * cos, p = Math.hypot(out, east);
      lat = Math.atan2(z, p * (1 - e2));
      let n = a;
      for (let k = 0; k < 4; k += 1) {
        n = a / Math.sqrt(1 - e2 * Math.sin(lat) ** 2);
        lat = Math.atan2(z + e2 * n * Math.sin(lat), p);
      }
      lon = lon0 + Math.atan2(east, out);
      up -= p / Math.cos(lat) - n;
    }
    return [lat / radians, lon / radians];
  }

  function tell_place(x, y) {
    $("pointer").textContent = Number.isFinite(x) ? `Pointer: ${place_words(x, y)}` : "\u00a0";
  }

  function make_values() {
    const head = element("tr", null, element("thead", null, $("values")));
    const several = scenes.length > 1;
    for (const text of [...(several ? ["Run"] : []), "AUV", "Error", "95 % within", "To aid vehicle"]) element("th", text, head).scope = "col";
    const body = element("tbody", null, $("values"));
    for (const map of maps) {
      map.cells = map.scene.auvs.map((auv) => {
        const row = element("tr", null, body);
        if (several) element("td", map.scene.label, row).title = map.scene.label;
        element("td", auv.name, row).title = auv.name;
        const cells = [0, 1, 2].map(() => element("td", "", row));
        return [...cells, element("td", "", row, "words")];
      });
      map.said = element("div", null, $("status"));
    }
  }

  function update_values(map) {
    const { scene, frame: k } = map, c = scene.pings.columns;
    scene.auvs.forEach((auv, i) => {
      const [error, within, away, range] = map.cells[i];
      error.textContent = auv.error ? metres(auv.error[k]) : "not known";
      within.textContent = metres(auv.major[k]);
      away.textContent = auv.separation ? metres(auv.separation[k]) : "–";
      let j = newest(c.t, state.t);
      while (j >= 0 && (c.auv[j] !== i || c.t[j] > state.t + 1e-4)) j -= 1;
      const said = j < 0 ? "no range yet" : `newest range ${ping_words(scene.pings, j)}; ${(state.t - c.t[j]).toFixed(0)} s ago`;
      if (range.textContent !== said) range.textContent = said;
      range.classList.toggle("broken", j >= 0 && !scene.pings.taken.includes(c.fate[j]));
    });
    map.said.replaceChildren();
    const whose = scenes.length > 1 ? `${scene.label}: ` : "";
    for (const aid of scene.aids) {
      if (!aid.status) continue;
      const code = aid.status[k], score = Number.isFinite(aid.score[k]) ? ` (score ${aid.score[k].toPrecision(4)})` : "";
      const said = code === 255 ? "no decision yet" : aid.words[code] + score;
      element("p", `${whose}${scene.aids.length > 1 ? `Planner of ${aid.name}` : "Planner"}: ${said}.`, map.said);
    }
    if (!scene.limits) return;
    const broken = scene.limits.violation[k], name = scene.limits.names[scene.limits.worst[k]];
    const kept = `All limits kept; nearest to being broken: ${name}, by ${metres(-broken)}.`;
    element("p", whose + (broken > 1e-6 ? `${name} broken by ${metres(broken)}.` : kept), map.said, broken > 1e-6 ? "broken" : "");
  }

  // ---- time ----------------------------------------------------------------------------------
  function show_time() {
    for (const map of maps) {
      update_map(map);
      update_values(map);
    }
    for (const { cursor } of panels) cursor.location = state.t / length;
    $("scrub").value = state.t;
    $("scrub").setAttribute("aria-valuetext", clock(state.t));
    $("clock").textContent = `${clock(state.t)} / ${clock(end).slice(0, 8)}`;
    keep_in_sight();
  }

  function seek(t) {
    state.t = Math.min(Math.max(t, 0), end);
    show_time();
  }

  function step(frames) {
    const longest = scenes.reduce((one, other) => (other.time.length > one.time.length ? other : one)).time;
    const k = Math.min(Math.max(newest(longest, state.t) + frames, 0), longest.length - 1);
    seek(longest[k]);
  }

  // Go to the next moment at which a range came or was lost, or to the one before.
  function to_ping(direction) {
    let best = null;
    for (const { pings } of scenes) {
      for (const t of pings.columns.t) {
        const away = direction * (t - state.t);
        if (away > 1e-3 && (best === null || away < direction * (best - state.t))) best = t;
      }
    }
    if (best !== null) seek(best);
  }

  let last = null;
  function play(on) {
    state.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    if (on && state.t >= end) state.t = 0;
    last = null;
    if (on) requestAnimationFrame(tick);
  }

  function tick(now) {
    if (!state.playing) return;
    if (last !== null) seek(state.t + ((now - last) / 1000) * state.speed);
    last = now;
    if (state.t >= end) play(false); else requestAnimationFrame(tick);
  }

  function set_speed(speed) {
    state.speed = speed;
    $("speed").value = speed;
  }

  // ---- what part of the map is seen ----------------------------------------------------------
  function frame_size() {
    const { inner_width, inner_height } = maps[0].view.frame.bbox.width ? { inner_width: maps[0].view.frame.bbox.width, inner_height: maps[0].view.frame.bbox.height } : maps[0].figure;
    return [inner_width || 400, inner_height || 300];
  }

  // Metres a pixel alike on both axes, about a place.
  function look_at(x, y, scale) {
    const [width, height] = frame_size();
    [view.x.start, view.x.end] = [x - (scale * width) / 2, x + (scale * width) / 2];
    [view.y.start, view.y.end] = [y - (scale * height) / 2, y + (scale * height) / 2];
  }

  function fit() {
    const low = [0, 1].map((k) => Math.min(...scenes.map((scene) => scene.low[k])));
    const high = [0, 1].map((k) => Math.max(...scenes.map((scene) => scene.high[k])));
    const [width, height] = frame_size();
    state.scale = Math.max((high[0] - low[0]) / width, (high[1] - low[1]) / height);
    look_at((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, state.scale);
  }

  // Labels of axes change with what is seen, and with them the room that is left for the map.
  function settle(times) {
    if (times === 0) return;
    requestAnimationFrame(() => requestAnimationFrame(() => { fit(); settle(times - 1); }));
  }

  const middle = () => [(view.x.start + view.x.end) / 2, (view.y.start + view.y.end) / 2];
  const scale = () => (view.x.end - view.x.start) / frame_size()[0];
  const zoom = (factor) => look_at(...middle(), scale() * factor);

  function keep_in_sight() {
    const followed = $("follow").value;
    if (followed === "" || !maps.length) return;
    const { scene, frame } = maps[0], one = [...scene.auvs, ...scene.aids][Number(followed)];
    if (Number.isFinite(one.x[frame])) look_at(one.x[frame], one.y[frame], scale());
  }

  // ---- beginning -----------------------------------------------------------------------------
  function option(select, value, text) {
    element("option", text, select).value = value;
  }

  function listen() {
    $("scrub").max = end;
    $("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
    const clicks = {
      play: () => play(!state.playing), back: () => step(-1), forward: () => step(1), before: () => to_ping(-1), next: () => to_ping(1),
      in: () => zoom(0.7), out: () => zoom(1 / 0.7), fit,
    };
    for (const [id, act] of Object.entries(clicks)) $(id).addEventListener("click", act);
    $("speed").addEventListener("change", (event) => set_speed(Number(event.target.value)));
    $("auv").addEventListener("change", (event) => choose(Number(event.target.value)));
    $("follow").addEventListener("change", keep_in_sight);
    $("whole").addEventListener("change", show_whole);
    document.addEventListener("keydown", pressed);
    dark.addEventListener("change", () => { themed.forEach((paint_it) => paint_it()); show_time(); });
  }

  function show_whole() {
    for (const map of maps) for (const one of map.whole) one.visible = $("whole").checked;
  }

  function pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const tag = event.target.tagName, typed = tag === "SELECT" || (tag === "INPUT" && event.target.type !== "range");
    if (typed || (event.key === " " && ["BUTTON", "SUMMARY"].includes(tag))) return;
    const faster = (by) => set_speed(SPEEDS[Math.min(Math.max(SPEEDS.indexOf(state.speed) + by, 0), SPEEDS.length - 1)]);
    const keys = {
      " ": () => play(!state.playing), ArrowLeft: () => step(event.shiftKey ? -10 : -1), ArrowRight: () => step(event.shiftKey ? 10 : 1),
      ArrowUp: () => faster(1), ArrowDown: () => faster(-1), Home: () => seek(0), End: () => seek(end), n: () => to_ping(1), p: () => to_ping(-1),
      "+": () => zoom(0.7), "-": () => zoom(1 / 0.7), f: fit, t: () => { $("whole").checked = !$("whole").checked; show_whole(); },
    };
    const act = keys[event.key] || keys[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  }

  function fill() {
    $("title").textContent = data.title;
    $("about").textContent = data.about;
    for (const note of data.notes) element("li", note, $("notes"));
    for (const speed of SPEEDS) option($("speed"), speed, `${speed}×`);
    option($("follow"), "", "nothing");
    [...scenes[0].auvs, ...scenes[0].aids].forEach((one, k) => option($("follow"), k, one.name));
    (data.groups || []).forEach((name, k) => option($("auv"), k, name));
    $("chooser").hidden = (data.groups || []).length < 2;
    document.querySelector("main").classList.toggle("several", scenes.length > 1);
    set_speed(SPEEDS.find((speed) => end / speed <= 90) || 100);
    const key = $("key"), scene = scenes[0];
    for (const auv of scene.auvs) add_key(key, auv.name, auv.known ? "vehicle" : "cross", auv.colour);
    if (scene.aids.length) add_key(key, "aid vehicle", "vehicle", "ink");
    add_key(key, "estimate and its 95 % ellipse", "ellipse", "faint");
    if (scene.plans.length) add_key(key, "survey plan", "line", "faint", true);
    const aids = scenes.flatMap((one) => one.aids);
    if (aids.some((aid) => aid.planned)) add_key(key, `path planned, up to ${AHEAD / 60} min ahead`, "level", "ink");
    else if (aids.length) add_key(key, `course for ${HELD} s on its present command`, "level", "ink");
    if (scene.rings.length) add_key(key, scene.rings.map((ring) => `${ring.name} ${ring.radius} m`).join(", "), "level", "limit");
    if (scene.areas.length) add_key(key, "keep-outs, geofence", "line", "limit");
    for (const picture of data.pictures || []) if (picture.key) add_shades(key, picture.key);
    add_key(key, "range that is lost or not taken", "line", "broken", true);
  }

  // All figures in one document, since they share axes.
  async function draw(all) {
    const document_ = new Bokeh.Document();
    for (const { figure } of all) document_.add_root(figure);
    const views = await Bokeh.embed.add_document_standalone(document_, document.body, all.map((one) => one.target));
    for (const one of all) one.view = views.get(one.figure);
  }

  async function begin() {
    fill();
    for (const scene of scenes) maps.push(make_map(scene));
    for (const panel of data.panels) panels.push(make_panel(panel));
    await draw([...maps, ...panels]);
    make_values();
    listen();
    choose(0);
    fit();
    let size = "";
    new ResizeObserver(([{ target }]) => {
      const now = `${target.clientWidth} ${target.clientHeight}`;
      if (now !== size) settle(2);
      size = now;
    }).observe(maps[0].target);
    window.player = { state, seek, step, maps, panels, geographic, view };
    document.documentElement.dataset.ready = "yes";
  }

  begin().catch((error) => {
    document.documentElement.dataset.ready = "no";
    $("about").textContent = `This page cannot be drawn in this browser (${error.message}); map.png and errors.png show the mission.`;
    throw error;
  });
})();
