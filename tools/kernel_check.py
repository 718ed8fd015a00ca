#!/usr/bin/env python3
"""The firmware's USB device at a Linux kernel: `tools/kernel_check.py TVC KERNEL.deb`.

TVC is a release build of `tvc`; KERNEL.deb is Debian's package of a kernel: `apt-get download linux-image-amd64` says
which one it depends on, and downloads that. QEMU starts the kernel, which attaches the rig by USB/IP (`tvc rig
--usbip`) and loads `cdc_acm`. In the machine run `lsusb -v`, 60 s of telemetry and 100 writes of parameters; a
parameter is read behind an unbound driver, a reset of the device and a suspended port. USB/IP passes neither reset nor
suspend on to the device. Exit status 1 if a step fails.

Needs Debian's packages qemu-system-x86, usbip, usbutils, busybox-static and kmod. Takes four minutes.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

MODULES = ["e1000", "vhci-hcd", "cdc-acm"]
PROGRAMS = ["/usr/sbin/usbip", "/usr/bin/lsusb", "/usr/bin/usbreset"]
DEVICE = "2341:8057"
WRITES = 100
INIT = f"""#!/bin/busybox sh
/bin/busybox --install -s /bin
mount -t proc none /proc; mount -t sysfs none /sys; mount -t devtmpfs none /dev; mkdir -p /tmp /run /var/run
dmesg -n 1
for module in {' '.join(MODULES)}; do modprobe $module; done
ip link set lo up; ip link set eth0 up; ip addr add 10.0.2.15/24 dev eth0
port=/dev/ttyACM0
result() {{ echo "RESULT $1: $2"; }}
attached() {{ for n in $(seq 60); do [ -c $port ] && return 0; sleep 1; done; return 1; }}
usbip --tcp-port PORT attach -r 10.0.2.2 -b 1-1 && attached
result attach $?
lsusb -v -d {DEVICE} >/tmp/lsusb 2>&1
cat /tmp/lsusb
! grep -qi "error\\|couldn't\\|cannot\\|invalid\\|warning" /tmp/lsusb
result lsusb $?
tvc info --port $port
answers() {{ tvc param get SFC_GAIN_S --port $port; }}
answers; result answers $?
tvc record /tmp/a.tlog --port $port --seconds 60 2>/tmp/record; result record $?
tvc log info /tmp/a.tlog --json; result log $?
good=0
for n in $(seq {WRITES}); do
  tvc param set SFC_GAIN_S 0.$((100 + n)) --port $port >/tmp/set 2>&1 && good=$((good + 1)) || cat /tmp/set
done
echo "$good of {WRITES} writes"; [ $good = {WRITES} ]; result writes $?
interface=$(basename $(readlink /sys/class/tty/ttyACM0/device))
echo $interface > /sys/bus/usb/drivers/cdc_acm/unbind; sleep 1
[ ! -c $port ] && echo $interface > /sys/bus/usb/drivers/cdc_acm/bind && attached && answers
result unbind $?
usbreset {DEVICE} && sleep 1 && attached && answers; result reset $?
power=/sys/bus/usb/devices/${{interface%:*}}/power
echo 0 > $power/autosuspend_delay_ms; echo auto > $power/control; sleep 4; cat $power/runtime_status
[ $(cat $power/runtime_status) = suspended ] && answers
result suspend $?
dmesg | grep -i "usb\\|cdc\\|vhci" | tail -40
poweroff -f
"""


def run(*command, **options):
    return subprocess.run(command, check=True, **options)


def libraries(program):
    listed = run("ldd", program, capture_output=True, text=True).stdout
    return re.findall(r"(/\S+)", listed)


def root_of(work, tvc, package, port):
    """The initial file system of the machine, and its kernel."""
    root, kernel = work / "root", work / "kernel"
    run("dpkg", "-x", package, kernel)
    [modules] = (kernel / "lib/modules").iterdir()
    run("depmod", "-b", kernel, modules.name)
    for module in MODULES:
        shown = run("modprobe", "-d", kernel, "-S", modules.name, "--show-depends", module, capture_output=True, text=True)
        for path in re.findall(r"^insmod (\S+)", shown.stdout, re.M):
            place = root / pathlib.Path(path).relative_to(kernel)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)
    for name in modules.glob("modules.*"):
        shutil.copy(name, root / "lib/modules" / modules.name)
    run("depmod", "-b", root, modules.name)
    for folder in ["bin", "dev", "proc", "sys", "usr/share/hwdata", "usr/share/misc"]:
        (root / folder).mkdir(parents=True, exist_ok=True)
    shutil.copy("/bin/busybox", root / "bin/busybox")
    for program, name in [*((program, pathlib.Path(program).name) for program in PROGRAMS), (tvc, "tvc")]:
        shutil.copy(program, root / "bin" / name)
        for library in libraries(program):
            place = root / library.lstrip("/")
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(library, place)
    for ids in ["/usr/share/misc/usb.ids", "/var/lib/usbutils/usb.ids", "/usr/share/hwdata/usb.ids"]:
        if pathlib.Path(ids).exists():
            shutil.copy(ids, root / "usr/share/misc/usb.ids")
    (root / "init").write_text(INIT.replace("PORT", str(port)))
    (root / "init").chmod(0o755)
    listing = run("find", ".", cwd=root, capture_output=True).stdout
    packed = work / "initrd"
    with packed.open("wb") as out:
        run("busybox", "cpio", "-o", "-H", "newc", cwd=root, input=listing, stdout=out, stderr=subprocess.DEVNULL)
    return packed, next((kernel / "boot").glob("vmlinuz-*"))


def main():
    tvc, package = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        rig = subprocess.Popen([tvc, "rig", "--usbip", "0"], stdout=subprocess.PIPE, text=True)
        try:
            port = int(rig.stdout.readline().rsplit(":", 1)[1])
            initrd, kernel = root_of(work, tvc, package, port)
            machine = ["qemu-system-x86_64", "-m", "512", "-nographic", "-no-reboot", "-nic", "user,model=e1000"]
            booted = ["-kernel", kernel, "-initrd", initrd, "-append", "console=ttyS0 quiet panic=-1"]
            shown = subprocess.run([*machine, *booted], capture_output=True, text=True, errors="replace", timeout=1800)
        finally:
            rig.terminate()
            rig.wait()
    print(shown.stdout)
    results = dict(re.findall(r"RESULT (\w+): (\d+)", shown.stdout))
    failed = [name for name, status in results.items() if status != "0"]
    lost = re.search(r'"lost":\s*(\d+)', shown.stdout)
    print(f"{len(results)} of 9 steps ran; failed: {', '.join(failed) or 'none'}; frames lost: {lost and lost[1]}")
    sys.exit(0 if len(results) == 9 and not failed and lost and lost[1] == "0" else 1)


main()
