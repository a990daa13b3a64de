"""`make test-vcan`: the CANopen tests over SocketCAN, in a machine whose kernel has CAN.

Many kernels, those of containers and build servers among them, have none. So a Debian kernel is unpacked and booted
in an emulated machine that sees this one's files, read-only beneath a layer in memory. There vcan0 is brought up, and
pytest runs the tests marked `vcan`.

    kernel      Debian's kernel package, fetched and unpacked; which of its modules are needed, in order
    initramfs   the first file system: busybox, those modules, init.sh
    init.sh     the first program: modules, files, vcan0, then the tests
    machine     the machine: booted, listened to, with a clock that knows nothing of the host's load
"""
