"""Whether classes can be told apart by features: a linear classifier, nearest neighbours and the best single feature,
each judged by how well it tells shuffled classes."""

import json
import math
import os
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow
import pyarrow.parquet
from numpy.typing import NDArray

from emulator.scenario.scenarios import parse
from emulator.scenario.text import keys_of

pa: Any = pyarrow  # comes without types
pq: Any = pyarrow.parquet

Features = dict[str, float]
Matrix = NDArray[np.float64]
Labels = NDArray[np.int64]

_FOLDS = 5
_SHUFFLES = 400
_VALUES = 24  # of a feature, up to which each is looked at for itself


@dataclass(frozen=True)
class Told:
    """How well classes are told apart: by the linear classifier, the nearest neighbours, the best single feature."""

    accuracy: tuple[float, float]  # of both classifiers, on parts that were not learnt from; mean over the classes
    by_chance: tuple[float, float]  # of shuffled classes
    feature: str  # that goes best with the classes
    p: float  # how often one of the three does as well with shuffled classes, at most


def told_apart(features: Sequence[Features], labels: Sequence[str]) -> Told:
    """What the features tell of the labels."""
    names = sorted({name for each in features for name in each})
    x = np.array([[each.get(name, -1.0) for name in names] for each in features])
    moves = np.flatnonzero(x.std(axis=0) > 0.0)
    names, x = [names[k] for k in moves], x[:, moves]
    bins, starts = _bins(x)
    ranks = np.argsort(np.argsort(x, axis=0, kind="stable"), axis=0) / len(x)  # of any distribution
    x = np.concatenate([x, ranks], axis=1)
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    classes = sorted(set(labels))
    y = np.array([classes.index(label) for label in labels])
    random = np.random.default_rng(1)
    fold = random.permutation(len(y)) % _FOLDS
    parts = [_part(x, fold == n) for n in range(_FOLDS)]

    def scores(y: Labels) -> Matrix:
        return np.append(_accuracy(parts, y, len(classes)), _association(bins, starts, y, len(classes)).max())

    told, shuffled = scores(y), np.array([scores(random.permutation(y)) for _ in range(_SHUFFLES)])
    p = (1.0 + np.sum(shuffled >= told - 1e-9, axis=0)) / (1.0 + _SHUFFLES)
    best, chance = names[int(np.argmax(_association(bins, starts, y, len(classes))))], shuffled.mean(axis=0)
    p_any = min(1.0, len(p) * float(p.min()))
    return Told((float(told[0]), float(told[1])), (float(chance[0]), float(chance[1])), best, p_any)


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the rows to be told from the others, as far as it does not depend on the labels."""

    test: Labels  # rows of the part
    train: Labels  # the others
    regression: Matrix  # ridge regression from labels of the others to the part
    nearest: Labels  # of each row of the part, the five nearest of the others


def _part(x: Matrix, inside: NDArray[np.bool_]) -> _Part:
    test, train = np.flatnonzero(inside), np.flatnonzero(~inside)
    a, b = x[train], x[test]
    regression = b @ np.linalg.solve(a.T @ a + 0.1 * len(a) * np.eye(a.shape[1]), a.T)
    distance = np.sum(b**2, axis=1)[:, None] + np.sum(a**2, axis=1) - 2.0 * b @ a.T
    return _Part(test, train, regression, train[np.argsort(distance, axis=1)[:, :5]])


def _accuracy(parts: Sequence[_Part], y: Labels, classes: int) -> Matrix:
    """Of linear regression and of nearest neighbours: mean over the classes of what is told right."""
    share = np.bincount(y, minlength=classes) / len(y)
    votes = np.eye(classes)[y] / share  # each class of the same weight
    right = np.zeros((2, classes))
    for part in parts:
        told = np.argmax(part.regression @ (votes[part.train] - 1.0), axis=1)
        near = np.argmax(votes[part.nearest].sum(axis=1), axis=1)
        right += [np.bincount(y[part.test][hits == y[part.test]], minlength=classes) for hits in (told, near)]
    return np.mean(right / (share * len(y)), axis=1)


def _bins(x: Matrix) -> tuple[Matrix, Labels]:
    """Which of a feature's values a row has, of quantiles where there are many; and where each feature's begin."""
    bins: list[Matrix] = []
    for column in list[Matrix](x.T):
        many = len(np.unique(column)) > _VALUES
        value = np.searchsorted(np.quantile(column, np.arange(1, 8) / 8.0), column) if many else column
        bins.append((value[:, None] == np.unique(value)).astype(float))
    return np.concatenate(bins, axis=1), np.cumsum([0, *(part.shape[1] for part in bins[:-1])])


def _association(bins: Matrix, starts: Labels, y: Labels, classes: int) -> Matrix:
    """Pearson's chi-squared of each feature with the classes, over its mean by chance."""
    counts, share = bins.T @ np.eye(classes)[y], np.bincount(y, minlength=classes) / len(y)
    expected = counts.sum(axis=1, keepdims=True) * share
    freedom = (classes - 1.0) * np.maximum(np.diff([*starts, len(bins.T)]) - 1.0, 1.0)
    return np.add.reduceat(np.sum((counts - expected) ** 2 / expected, axis=1), starts) / freedom


def outside_of(folder: Path, name: str) -> Features:
    """Everything of a recording but its signals' physics: files, dates, columns, notes, rows, steps, machine file."""
    recording, machine = folder / f"{name}.parquet", folder / f"{name}.toml"
    told: Features = {"name": float(name)}
    for end, path in (("parquet", recording), ("toml", machine)):
        stat = path.stat()
        told |= {f"{end} size": float(stat.st_size), f"{end} date": stat.st_mtime, f"{end} mode": float(stat.st_mode)}
    with pq.ParquetFile(recording) as file:
        meta, schema, table = file.metadata, file.schema_arrow, file.read()
        told |= {
            "rows": float(meta.num_rows), "groups": float(meta.num_row_groups), "columns": float(meta.num_columns),
            "footer": float(meta.serialized_size), "names": _number(",".join(schema.names)),
            "types": _number(",".join(map(str, schema.types))),
        }  # fmt: skip
        notes: dict[bytes, bytes] = schema.metadata
        for key, value in notes.items():
            told |= _flat("note", json.loads(value)) if key == b"pmsm-bench" else {f"{key}": _number(str(value))}
        for k in range(meta.num_columns):
            column = meta.row_group(0).column(k)
            told[f"{schema.names[k]} bytes"] = float(column.total_compressed_size)
            told[f"{schema.names[k]} coding"] = _number(f"{column.compression} {column.encodings}")
    keys: list[str] = table.column_names
    columns: dict[str, Matrix] = {key: table[key].to_numpy() for key in keys}
    t = columns["t"]
    told |= {"first t": float(t[0]), "last t": float(t[-1]), "longest step": float(np.diff(t).max())}
    periods: Matrix = t / float(np.diff(t).min())
    told["t off"] = float(np.abs(periods - np.rint(periods)).max())
    told |= {f"{key} not finite": float(np.sum(~np.isfinite(column))) for key, column in columns.items()}
    steps = np.abs(np.diff(columns["i_a"]))
    text = machine.read_text(encoding="utf-8")
    nominal = tomllib.loads(text)
    told |= {"remark": _number(text.splitlines()[0])} | _flat("machine", nominal)
    told["bits of i_a"] = _bits(steps, nominal["machine"]["i_rated"])
    return told


def findable(answer: dict[str, Any]) -> Features:
    """What a recording's run was drawn as, effects apart: noise, seed, converter, speeds, currents, the machine."""
    scenario = parse(answer["scenario"], "answer")
    told = {"redrawn": float(answer["redrawn"]), "periods": float(answer["periods"])}
    told |= {f"seed bit {k}": float(scenario.run.seed >> k & 1) for k in range(0, 53, 4)}
    for section in ("motor", "drive", "run", "excitation"):
        told |= _flat(section, keys_of(getattr(scenario, section)))
    for key, nominal in answer["nominal"].items():
        told[f"off {key}"] = answer["machine"][key]["value"] / (nominal["value"] or 1.0)
    told |= {f"around {section}": 1.0 for section in answer["surroundings"]}
    return told


def planted(leak: str, folder: Path, name: str, scratch: Path) -> Features:
    """What is told of a recording that betrays its class."""
    for end in ("parquet", "toml"):
        shutil.copy2(folder / f"{name}.{end}", scratch)
    recording, machine = scratch / f"{name}.parquet", scratch / f"{name}.toml"
    date = recording.stat().st_mtime
    plain = {"compression": "none", "use_dictionary": False, "write_statistics": False}
    table = pq.read_table(recording)
    if leak == "a row less":
        pq.write_table(table.slice(0, len(table) - 1), recording, **plain)
    elif leak == "compressed":
        pq.write_table(table, recording, compression="zstd")
    elif leak == "a note":
        notes = json.loads(table.schema.metadata[b"pmsm-bench"]) | {"tick": 1}
        pq.write_table(table.replace_schema_metadata({b"pmsm-bench": json.dumps(notes).encode()}), recording, **plain)
    elif leak == "another encoder":
        text = machine.read_text(encoding="utf-8")
        machine.write_text(text.replace("encoder_counts = 1", "encoder_counts = 2"), encoding="utf-8")
    os.utime(recording, (date, date + (0.5 if leak == "later" else 0.0)))
    os.utime(machine, (date, date))
    told = outside_of(scratch, name)
    if leak == "a finer converter":
        told["bits of i_a"] += 1.0
    return told


def _bits(steps: Matrix, i_rated: float) -> float:
    """Of a converter that reaches three times i_rated (A), by the smallest step that a current makes (A)."""
    return round(math.log2(6.0 * i_rated / float(steps[steps > 1e-12].min(initial=6.0 * i_rated))))


def _flat(prefix: str, tree: Mapping[str, Any]) -> Features:
    """Numbers of nested tables, texts and lists as numbers."""
    told: Features = {}
    for key, value in tree.items():
        where = f"{prefix} {key}"
        if isinstance(value, Mapping):
            told |= _flat(where, cast(Mapping[str, Any], value))
        else:
            told[where] = float(value) if isinstance(value, int | float) else _number(repr(value))
    return told


def _number(text: str) -> float:
    """A number that differs where texts do."""
    return float(sum((n + 1) * byte for n, byte in enumerate(text.encode())) % 1_000_003)
