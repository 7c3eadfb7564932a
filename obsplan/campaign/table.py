"""The results as a table: one row per mission, in one order, whoever flew them and when."""

import csv
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from obsplan.campaign.faults import CSV, FILE, PARQUET, no_store
from obsplan.campaign.layout import FIGURES
from obsplan.campaign.store import BLOCK, Store
from obsplan.spelling import inert
from obsplan.types import ObsplanError

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

LABELS = ("scenario", "planner")  # then the varied keys, then the rest
REST = ("seed", "status", "error", *FIGURES, "auv", "status_counts")


def load_campaign(folder: Path | str) -> "pd.DataFrame":
    """Read a campaign's results, also while it runs or after it was interrupted.

    One row per mission, sorted: ``scenario``, ``planner``, each varied key, ``seed``, ``status``
    (done or failed), ``error``, the figures of `Run.summary` over all AUVs (nan where the mission
    failed), and as JSON ``auv``, the figures of each, and ``status_counts``, how often the planner
    said what. Where a scenario, or the version or code that flies, was changed between campaigns,
    only results of the last one are in it.

    Raises
    ------
    ObsplanError
        The folder has no campaign, or its store is damaged.
    """
    import pyarrow as pa

    with existing_store(Path(folder)) as store:
        store.check()
        table = Layout.of(store)
        return pa.Table.from_batches(table.batches(store), table.schema()).to_pandas()


def existing_store(folder: Path) -> Store:
    """The store in a campaign's folder, which must be there."""
    if not (folder / FILE).exists():
        raise no_store(
            folder, "has no campaign", "give the folder that `obsplan campaign --out` made"
        )
    return Store(folder)


def export(store: Store, folder: Path) -> None:
    """Write the table as Parquet and CSV, whole or not at all.

    The same results give the same bytes.

    Raises
    ------
    ObsplanError
        They cannot be written.
    """
    import pyarrow.parquet as pq

    with (
        store.frozen(),
        replacing(folder / PARQUET) as parquet_path,
        replacing(folder / CSV) as csv_path,
    ):
        table = Layout.of(store)
        with (
            pq.ParquetWriter(parquet_path, table.schema()) as parquet,
            csv_path.open("w", encoding="utf-8", newline="") as text,
        ):
            lines = csv.writer(text, lineterminator="\n")
            lines.writerow(table.names)
            for batch in table.batches(store):
                parquet.write_batch(batch)
                cells = (map(inert, column.to_pylist()) for column in batch.columns)
                lines.writerows(zip(*cells, strict=True))


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside a file.

    It takes the file's place if all goes well, and otherwise leaves nothing.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        reason = error.strerror or error
        raise ObsplanError(
            f"{path} cannot be written ({reason}): "
            "free some space or make the folder writable, and repeat"
        ) from error
    finally:
        with suppress(OSError):  # replaced, or never there
            part.unlink()


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Columns of the table, and its cells in order, each with its labels."""

    varied: tuple[str, ...]
    # number in the store; scenario, planner, value of each varied key
    cells: tuple[tuple[int, tuple[Any, ...]], ...]

    @classmethod
    def of(cls, store: Store) -> "Layout":
        """Layout of what a store holds now."""
        varied = tuple(store.varied_keys())
        cells = [
            (cell, (scenario, planner, *(look_up(content, key) for key in varied)))
            for cell, scenario, planner, content in store.current_cells()
        ]
        labels = list(zip(*(label for _, label in cells), strict=True))
        columns = (
            [labels[0], labels[1], *(uniform(column) for column in labels[2:])] if cells else []
        )
        tidy = [
            (cell, label)
            for (cell, _), label in zip(cells, zip(*columns, strict=True), strict=True)
        ]
        return cls(
            varied=varied,
            cells=tuple(sorted(tidy, key=lambda one: [(value is None, value) for value in one[1]])),
        )

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [*LABELS, *self.varied, *REST]

    def schema(self) -> "pa.Schema":
        """Types of the columns."""
        import pyarrow as pa

        def kind(i: int) -> pa.DataType:
            column = [label[i] for _, label in self.cells if label[i] is not None]
            return pa.string() if any(isinstance(value, str) for value in column) else pa.float64()

        labels = [(name, kind(i)) for i, name in enumerate((*LABELS, *self.varied))]
        rest = [
            (
                name,
                pa.float64() if name in FIGURES else pa.int64() if name == "seed" else pa.string(),
            )
            for name in REST
        ]
        return pa.schema([*labels, *rest])

    def batches(self, store: Store) -> "Iterator[pa.RecordBatch]":
        """The rows, a block at a time: memory does not grow with the campaign."""
        import pyarrow as pa

        schema = self.schema()
        rows = (
            (*label, seed, "done" if error is None else "failed", error, *rest)
            for cell, label in self.cells
            for seed, error, *rest in store.rows(cell)
        )
        while block := list(islice(rows, BLOCK)):
            columns = zip(*block, strict=True)
            yield pa.record_batch(
                [
                    pa.array(column, kind)
                    for column, kind in zip(columns, schema.types, strict=True)
                ],
                schema=schema,
            )


def look_up(content: Any, key: str) -> Any:
    """The value of ``table.key`` in a scenario, or None where it has none."""
    for part in key.split("."):
        if isinstance(content, list):
            content = content[int(part)] if part.isdigit() and int(part) < len(content) else None
        else:
            content = content.get(part) if isinstance(content, dict) else None
    return content


def uniform(column: Sequence[Any]) -> list[Any]:
    """Numbers as numbers if there is nothing else, otherwise all as text, missing ones left out."""
    given = [value for value in column if value is not None]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in given):
        return [None if value is None else float(value) for value in column]
    return [
        value if value is None or isinstance(value, str) else json.dumps(value) for value in column
    ]
