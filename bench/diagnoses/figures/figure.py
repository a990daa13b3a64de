"""Figures as data: panels with axes and traces, as they are published.

`python -m bench.diagnoses.figures.figure` prints the JSON schema. Knows nothing of diagnoses and of drawing.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pydantic import ConfigDict, Field, TypeAdapter

_PUBLISHED: Final = ConfigDict(extra="forbid", json_schema_serialization_defaults_required=True)
Role = Literal[
    "before", "after", "noise", "measured", "level", "chosen", "not_chosen", "promised", "each", "joint", "differs"
]
Kind = Literal["line", "markers", "bars", "heatmap", "intervals"]
Scale = Literal["linear", "log", "exponent"]
Number = float | None  # None, in JSON null: nothing is there
Numbers = tuple[Number, ...]


@dataclass(frozen=True, slots=True)
class Axis:
    """What stands along an axis, and from where to where."""

    __pydantic_config__ = _PUBLISHED

    label: Annotated[str, Field(description="what it is, in words or letters", examples=["time"])]
    unit: Annotated[str, Field(description="SI but for deg, rpm and %; empty where there is none", examples=["s"])]
    low: Annotated[float, Field(description="left, or lower, end", examples=[0.0])]
    high: Annotated[float, Field(description="right, or upper, end", examples=[6.0])]
    scale: Annotated[Scale, Field(description="exponent: linear, of numbers that are exponents of ten")] = "linear"
    names: Annotated[tuple[str, ...], Field(description="of 0, 1, 2, ... on it, where bars have names")] = ()


@dataclass(frozen=True, slots=True)
class Trace:
    """What is drawn in a panel."""

    __pydantic_config__ = _PUBLISHED

    name: Annotated[str, Field(description="for a legend", examples=["before"])]
    role: Annotated[Role, Field(description="what it is; whoever draws it has a colour for each")]
    kind: Kind
    x: Annotated[Numbers, Field(
        description="in the axis's unit: of points; of bars, which lie, how far they reach from 0; of a heatmap, its "
        "edges, one more than z has columns; of intervals, which lie, the two ends of each", examples=[[0.0, 3.0, 6.0]],
    )]  # fmt: skip
    y: Annotated[Numbers, Field(
        description="in the axis's unit: of points, bars and intervals; of a heatmap, its edges, one more than z has "
        "rows",
        examples=[[0.31, 0.28, None]],
    )]  # fmt: skip
    z: Annotated[
        tuple[Numbers, ...], Field(description="in the unit of the figure's z: of a heatmap, a row for each step of y")
    ] = ()
    level: Annotated[
        tuple[int, int] | None, Field(description="of the role level: the k-th of n, from 1", examples=[[1, 6]])
    ] = None


@dataclass(frozen=True, slots=True)
class Panel:
    """Axes and what is drawn over them."""

    __pydantic_config__ = _PUBLISHED

    title: Annotated[str, Field(description="above it; empty where it needs none", examples=["u_q"])]
    x: Axis
    y: Axis
    traces: tuple[Trace, ...]


@dataclass(frozen=True, slots=True)
class Figure:
    """A picture. Panels whose axes are the same, one beside or below the other, share them."""

    __pydantic_config__ = _PUBLISHED

    part: Annotated[str, Field(description="of the report", examples=["map"])]
    name: Annotated[str, Field(description="unlike all others", examples=["map-0"])]
    title: Annotated[str, Field(description="of its part, whose figures share it", examples=["Where it is"])]
    caption: Annotated[str, Field(description="a sentence below it", examples=["What is left of the voltage, rms"])]
    panels: tuple[Panel, ...]
    beside: Annotated[bool, Field(description="one panel beside the other where there is room; else below")] = False
    z: Annotated[Axis | None, Field(description="what the colours of heatmaps stand for")] = None


@dataclass(frozen=True, slots=True)
class Figures:
    """The pictures of a diagnosis, in the report's order, as GET /api/recordings/{id}/diagnosis/figures gives them.

    Null stands for a number that is not there: a line has a gap, a heatmap a hole.
    """

    __pydantic_config__ = _PUBLISHED

    figures: tuple[Figure, ...]


_ADAPTER: Final = TypeAdapter(Figures)


def figures_text(figures: Sequence[Figure]) -> str:
    """Figures as JSON."""
    return _ADAPTER.dump_json(Figures(tuple(figures))).decode()


def schema(references: str = "#/$defs/{model}") -> dict[str, Any]:
    """The JSON schema of figures (draft 2020-12); the references to its parts as they are to look."""
    told = _ADAPTER.json_schema(ref_template=references, mode="serialization")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:pmsm-bench:figures"} | told


if __name__ == "__main__":
    sys.stdout.write(json.dumps(schema(), indent=2) + "\n")
