"""`python -m tests.bars.tuned_numbers [FOLDER]`: how many numbers the diagnosis has that somebody chose.

Counted are numbers in named constants of modules, but 0, 1 and 2, and numbers elsewhere in the code, but 0, 1, 2, 3, 4
and a half, which are of formulas, and those of at most 1e-9, which keep a division from nothing. A number that is
derived is counted, too: a constant's name and comment say what it is.
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import estimator.diagnosis

_OF_CONSTANTS: Final = (0, 1, 2)
_OF_FORMULAS: Final = (0, 1, 2, 3, 4, 0.5)
_NOTHING: Final = 1e-9


def counted(text: str) -> tuple[int, int, int]:
    """Of a module's text: named constants that hold such numbers, numbers in these, numbers elsewhere."""
    constants = named = elsewhere = 0
    for statement in ast.parse(text).body:
        if _is_constant(statement):
            here = [x for x in _numbers(statement) if x not in _OF_CONSTANTS]
            constants, named = constants + bool(here), named + len(here)
        else:
            elsewhere += sum(x not in _OF_FORMULAS and abs(x) > _NOTHING for x in _numbers(statement))
    return constants, named, elsewhere


def _is_constant(statement: ast.stmt) -> bool:
    if isinstance(statement, ast.Assign):
        (target,) = statement.targets
    elif isinstance(statement, ast.AnnAssign):
        target = statement.target
    else:
        return False
    return isinstance(target, ast.Name) and target.id.lstrip("_").isupper()


def _numbers(statement: ast.stmt) -> Iterator[float]:
    for node in ast.walk(statement):
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield float(str(node.value))


def main() -> None:
    """Count, by rooms."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(str(estimator.diagnosis.__file__)).parent
    rooms = Counter[str](), Counter[str](), Counter[str]()
    for path in sorted(folder.rglob("*.py")):
        inside = path.relative_to(folder).parts
        for room, n in zip(rooms, counted(path.read_text(encoding="utf-8")), strict=True):
            room[inside[0] if len(inside) > 1 else "."] += n
    constants, named, elsewhere = rooms
    print(f"{'':14} constants  numbers in them  elsewhere")
    for room in sorted({room for counts in rooms for room in counts}):
        print(f"{room:14} {constants[room]:9}  {named[room]:15}  {elsewhere[room]:9}")
    sums = [sum(room.values()) for room in rooms]
    print(f"{'all':14} {sums[0]:9}  {sums[1]:15}  {sums[2]:9}   {sums[1] + sums[2]} numbers")


if __name__ == "__main__":
    main()
