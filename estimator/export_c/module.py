"""The C module's files for a window, the parameters that are estimated, and a type of numbers.

Texts with `$name` are templates; all else is C as it is. Knows nothing of folders.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Final

from estimator.interval import Z_95
from estimator.machine import PARAMETERS
from estimator.online.window_ls import check_window
from estimator.online.window_sums import BATCH, SHORTEST_BATCH

TYPES: Final = {"float32": 4, "float64": 8}  # bytes of a number
MOST_BYTES: Final = 2**20  # of static memory: more than a drive's processor has
BLOCK: Final = 32  # rows, as in the header
_HERE: Final = Path(__file__).parent
_ROW: Final = 7  # numbers of a row in the ring,
_SUMS: Final = {True: 50, False: 40}  # and of a block's sums, with psi_f among the estimated or without,
_SETTINGS: Final = 8  # of the settings, beside a whole number,
_OTHER: Final = 18  # and of what else there is,
_COUNTS: Final = 7  # beside so many whole numbers of 4 bytes and those that hold a bit a row
_QUANTILES: Final = 32  # steps of Student's table


@dataclass(frozen=True, slots=True)
class Module:
    """What is asked for."""

    window: int  # samples
    estimated: tuple[str, ...]  # in the order of PARAMETERS
    type: str  # of TYPES

    @property
    def places(self) -> tuple[int, ...]:
        """Places of the estimated parameters in PARAMETERS."""
        return tuple(PARAMETERS.index(name) for name in self.estimated)

    @property
    def bytes(self) -> int:
        """Static memory of the window's state."""
        size, blocks = TYPES[self.type], self.window // BLOCK + 1
        numbers = _ROW * self.window + _SUMS["psi_f" in self.estimated] * blocks + _SETTINGS + _OTHER
        whole = (4, 4 * (_COUNTS + -(-self.window // 32)))
        return numbers * size + sum(-(-each // size) * size for each in whole)


def module_of(window: int, estimated: Sequence[str], kind: str) -> Module:
    """What is asked for. Raises ValueError, in a sentence, where there can be no such module."""
    for name in estimated:
        if name not in PARAMETERS:
            raise ValueError(f"parameters are some of {', '.join(PARAMETERS)}, got {name!r}")
    if not estimated or len(set(estimated)) < len(estimated):
        raise ValueError(f"expected each parameter once, and one at least, got {', '.join(estimated) or 'none'}")
    if kind not in TYPES:
        raise ValueError(f"type must be {' or '.join(TYPES)}, got {kind!r}")
    check_window(window, 1, len(estimated))
    module = Module(window, tuple(name for name in PARAMETERS if name in estimated), kind)
    if module.bytes > MOST_BYTES:
        raise ValueError(f"a window of {window} samples takes {module.bytes:,} bytes, expected {MOST_BYTES:,} at most")
    return module


def sources(module: Module) -> dict[str, str]:
    """The module's C by file."""
    header = _text("pmsm_window.h").substitute(
        window=f"{module.window}u", estimated=len(module.estimated),
        places="{" + ", ".join(f"PMSM_{name.upper()}" for name in module.estimated) + "}",
        double=int(module.type == "float64"), flux=int("psi_f" in module.estimated),
    )
    solve = _text("pmsm_solve.c").substitute(student=_lines(_student()), turns=_lines(_turns()))
    plain = {name: _read(name) for name in ("pmsm_rows.h", "pmsm_window.c", "pmsm_check.c")}
    return {"pmsm_window.h": header, "pmsm_solve.c": solve, **plain}


def page(module: Module) -> str:
    """The README that goes with them."""
    held = [name for name in PARAMETERS if name not in module.estimated]
    return _text("page.md").substitute(
        window=module.window, type=module.type, estimated=_listed(module.estimated),
        held=f", {_listed(held)} held at known values" if held else "", bytes=f"{module.bytes:,}",
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _text(name: str) -> Template:
    return Template(_read(name))


def _read(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


def _student() -> list[str]:
    from scipy.special import stdtrit

    freedom = [math.inf, *(_QUANTILES / k for k in range(1, _QUANTILES + 1))]
    return [f"R({float(stdtrit(f, 0.975)) / Z_95:.9g})" for f in freedom]


def _turns() -> list[str]:
    return [
        f"{{R({math.cos(math.pi / n):.17g}), R({math.sin(math.pi / n):.17g})}}"
        for n in range(SHORTEST_BATCH, BATCH + 1)
    ]


def _lines(items: Sequence[str], indent: str = "    ") -> str:
    lines, line = list[str](), indent.rstrip("\n")
    for item in items:
        if len(line) + len(item) + 2 > 116:
            lines.append(line.rstrip())
            line = indent
        line += f"{item}, "
    return "\n".join([*lines, line.rstrip()])
