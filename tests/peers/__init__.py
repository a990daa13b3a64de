"""Our emulated drive beside other simulators of the same machine. `make peers` runs it.

Peers: motulator (Aalto University), whose equations, integration (scipy's solve_ivp), modulation and control are the
work of others, in Python; and gym-electric-motor (Paderborn University), for speed only.

*Same voltages.* The emulated drive is recorded over one second: speed control through a ramp and a swing, under load,
both current references stepping. The voltages of that recording, and nothing else of it, are put on motulator's machine
and shaft. Both start alike, and motulator's shaft is free: an error of ours in the machine, the modulator, the edges
or the recording's own convention of angles and periods moves its currents, its torque and in the end its speed.
Once with averaged bridges, once with edges: space-vector modulation here against carrier comparison there, at the
timer's resolution.

Machines that saturate are told to motulator by their current as a function of flux linkage: see `saturated`.

*Same references.* motulator's own drive, its vector control included, gets the same speed reference, load, direct
current and bandwidths as ours. Its current loop is another than ours, so the current references do not step here.

What is compared are samples at the starts of control periods: currents, the torque, and the mean speed over each
period. The error is the rms of the difference over the rms of motulator's signal, and its bar is 1 %. Sensors are
ideal: motulator's are.
"""
