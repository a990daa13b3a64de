"""The drive: plant and firmware stepped together, behind the drive's dictionary. No clock, no thread.

* `stream` - the rows it sends; `recorder` - its recorder
* `simulation` - plant, sensors, firmware and stream in one compiled loop; `assembly` - a scenario made ready for it;
  `in_place` - the same from step to step, without a state that is handed to and fro
* `control_lease` - who controls the drive; `memory` - what it keeps over a power cycle
* `virtual_drive` - all of it behind the dictionary, advanced by control periods

Knows nothing of buses and of real time.
"""
