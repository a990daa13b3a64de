#!/bin/busybox sh
# The first program of the machine. Output goes to the console, the tests' exit status to the second serial line.
# /settings sets modules and command.

/bin/busybox --install -s /bin
export PATH=/bin

fail() {
    echo "the machine: $1"
    poweroff -f
}

mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t devtmpfs devtmpfs /dev
stty -onlcr < /dev/console
. /settings

for module in $modules; do
    insmod /modules/$module.ko || fail "the kernel does not take its module $module"
done

# The host's files, read-only, and over them a layer in memory that takes what is written
mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=524288,cache=loose host /host || fail "no files of the host"
mount -t tmpfs tmpfs /written
mkdir /written/upper /written/work
mount -t overlay -o lowerdir=/host,upperdir=/written/upper,workdir=/written/work overlay /root || fail "no root"
for folder in proc sys dev; do
    mount -o bind /$folder /root/$folder
done
mkdir -p /root/dev/shm
mount -t tmpfs tmpfs /root/dev/shm

ip link set lo up
ip link add vcan0 type vcan && ip link set vcan0 up || fail "no vcan0"

read -r uptime _ < /proc/uptime
echo "the machine is up after $uptime s"
chroot /root /bin/sh -c "$command" < /dev/null
echo $? > /dev/ttyS1
poweroff -f
