"""The gallery has a picture for every effect, draws it, and its page tells what it is."""

import hashlib
import re
from pathlib import Path

import pytest

from emulator.scenario.effects import Effects
from tests.gallery import PICTURES, chain, drive, motor, shaft, supply
from tests.gallery.page import page
from tests.gallery.picture import save

pytestmark = pytest.mark.slow


def test_every_effect_has_a_picture_and_every_picture_an_effect() -> None:
    drawn = [name for room in (supply, motor, shaft, drive, chain) for name in room.PICTURES]
    assert sorted(drawn) == sorted(Effects._fields)
    assert tuple(PICTURES) == Effects._fields


@pytest.mark.parametrize("name", ["inverter", "imbalance"])
def test_a_picture_is_drawn_the_same_to_the_bit_every_time(tmp_path: Path, name: str) -> None:
    digests = set[str]()
    for n in range(2):
        file = tmp_path / str(n) / f"{name}.png"
        save(PICTURES[name], file)
        assert file.read_bytes().startswith(b"\x89PNG")
        digests.add(hashlib.sha256(file.read_bytes()).hexdigest())
    assert len(digests) == 1


def test_the_page_has_every_effects_picture_words_and_file() -> None:
    text = page(PICTURES)
    for name, picture in PICTURES.items():
        section = text.split(f'<section id="{name}">')[1].split("</section>")[0]
        assert f'<img src="{name}.png"' in section
        assert f"[effects.{name}]" in section
        assert len(picture.look) > 40
        assert len(picture.confused) > 40
        file = re.search(r"<code>(emulator/plant/physics/\w+\.py)</code>", section)
        assert file is not None
        assert (Path(__file__).parents[2] / file[1]).is_file()
        assert len(section.split("<pre>")[1]) > 300
