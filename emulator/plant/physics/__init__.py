"""The physics that a machine, its inverter and its sensors may have beyond the textbook, one effect a file.

Every file says the equation, its source, and how the effect shows; its named tuple holds the sizes, in SI, with the
range each may have: that tuple is a section `[effects.<name>]` of a scenario.
Effects know nothing of each other; `plant.dynamics` and `plant.bridge` bring them together.
"""
