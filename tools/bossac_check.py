#!/usr/bin/env python3
"""The real bossac against a model of the Nano's bootloader: `tools/bossac_check.py IMAGE.bin`.

The model speaks SAM-BA with Arduino's extensions X, Y and Z on a pseudo-terminal, and keeps flash as the chip does:
writing clears bits, erasing goes by rows of 256 bytes. bossac is started as `tvc flash` starts it; then the image must
be in flash from 0x2000 on, and the bootloader below and the parameters at 0x3F800 must be as they were. With `-e`
bossac must erase the parameters in the model, too: otherwise the check would prove nothing.
"""

import os
import re
import subprocess
import sys
import threading
import tty

FLASH, RAM, NVM, ROW = 0x40000, 0x20000000, 0x41004000, 256
BOOTLOADER, IMAGE, PARAMETERS = 0x0, 0x2000, 0x3F800
WORDS = {0xE000ED00: 0x410CC601, 0x41002018: 0x10010305, NVM + 0x14: 1}  # CPUID, DID of a G18A, NVM ready


def crc16(data):
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


class Nano:
    def __init__(self):
        self.flash = bytearray(b"old!" * (FLASH // 4))
        self.ram = bytearray(0x8000)
        self.registers = dict(WORDS)
        self.source = 0
        self.erased = 0

    def read(self, at, size):
        if at + size <= FLASH:
            return bytes(self.flash[at : at + size])
        if RAM <= at < RAM + len(self.ram):
            return bytes(self.ram[at - RAM : at - RAM + size])
        return self.registers.get(at, 0).to_bytes(4, "little")[:size]

    def erase(self, at):
        at -= at % ROW
        self.flash[at : at + ROW] = b"\xff" * ROW
        self.erased += 1

    def write_word(self, at, value):
        self.registers[at] = value
        if at == NVM and value & 0xFF == 0x02:  # CTRLA: erase the row at ADDR, in half-words
            self.erase(self.registers[NVM + 0x1C] * 2)
        self.registers[NVM + 0x14] = 1

    def write_flash(self, at, size):
        for i, byte in enumerate(self.read(self.source, size)):
            self.flash[at + i] &= byte

    def serve(self, port):
        text = b""
        while True:
            while not (found := re.match(rb"([A-Za-z])([0-9A-Fa-f]*),?([0-9A-Fa-f]*)#", text)):
                try:
                    text += os.read(port, 4096)
                except OSError:
                    return
            text = text[found.end() :]
            verb = found[1].decode()
            a, b = (int(number or b"0", 16) for number in found.groups()[1:])
            if verb == "S":
                while len(text) < b:
                    text += os.read(port, 4096)
                self.ram[a - RAM : a - RAM + b], text = text[:b], text[b:]
            elif verb == "W":
                self.write_word(a, b)
            elif verb == "X":
                for row in range(a, FLASH, ROW):
                    self.erase(row)
            elif verb == "Y" and b:
                self.write_flash(a, b)
            elif verb == "Y":
                self.source = a
            answers = {
                "N": lambda: b"\n\r",
                "V": lambda: b"v2.0 [Arduino:XYZ] Apr 19 2019 14:38:48\n\r",
                "w": lambda: self.read(a, 4),
                "o": lambda: self.read(a, 1),
                "R": lambda: self.read(a, b),
                "X": lambda: b"X\n\r",
                "Y": lambda: b"Y\n\r",
                "Z": lambda: b"Z%08X#\n\r" % crc16(self.read(a, b)),
            }
            os.write(port, answers.get(verb, lambda: b"")())


def flash(path, *more):
    """The Nano after bossac has written the image."""
    nano = Nano()
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    threading.Thread(target=nano.serve, args=[ours], daemon=True).start()
    port = os.ttyname(theirs).removeprefix("/dev/")
    arguments = [f"--port={port}", "-U", "-i", *more, "-w", "-v", "-R", "--offset=0x2000", path]
    done = subprocess.run(["bossac", *arguments], capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout.decode()
    return nano


def main():
    path = sys.argv[1]
    image = open(path, "rb").read()
    old = Nano().flash
    nano = flash(path)
    assert nano.flash[IMAGE : IMAGE + len(image)] == image, "the image is not in flash"
    assert nano.flash[BOOTLOADER:IMAGE] == old[BOOTLOADER:IMAGE], "the bootloader is damaged"
    assert nano.flash[PARAMETERS:] == old[PARAMETERS:], "the parameters are lost"
    print(f"image in place, {nano.erased} rows erased, bootloader and parameters as they were")
    assert flash(path, "-e").flash[PARAMETERS:] != old[PARAMETERS:], "-e should take the parameters"
    print("with -e the parameters are gone, so the model shows when they are erased")


main()
