"""The gallery: for every effect that the plant can have, its fingerprint beside the ideal drive. `make gallery`."""

from emulator.scenario.effects import Effects
from tests.gallery import chain, drive, motor, shaft, supply

_ALL = supply.PICTURES | motor.PICTURES | shaft.PICTURES | drive.PICTURES | chain.PICTURES
PICTURES = {name: _ALL[name] for name in Effects._fields}
