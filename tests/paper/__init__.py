"""The published experiment on the emulated drive: its table, its figures, its findings. `make paper` runs it.

The data: one second of the emulated drive (speed loop, two current loops, space-vector modulation, switched bridge),
recorded in every control period of 0.1 ms, with ideal current sensors or with 10 mA of noise and 12 bits.

Seeds move the current steps and the noise. Whatever is chosen here - rows, windows, forgetting - was chosen while
looking at the development seeds 1, 2 and 3. What is printed, drawn and held against a bar is from the seeds 101 to 105,
and on those nothing is chosen.
All seven temperatures of one seed share its steps and its noise: five seeds are five draws, not thirty-five.
"""
