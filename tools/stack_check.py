#!/usr/bin/env python3
"""Compares the stack of every function as `lab stack` finds it in the machine code with what the compiler says that it gave
the function (`-Zemit-stack-sizes`, which a compiler of the stable channel has behind RUSTC_BOOTSTRAP).

Functions that the compiler says nothing of were assembled or compiled elsewhere: the start of cortex-m-rt, and what takes
the place of missing instructions (compiler-builtins). They are counted.

    python3 tools/stack_check.py [FOLDER]      FOLDER: where to build the image [default: target/stack-sizes]
"""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = "thumbv6m-none-eabi"


def build(folder):
    """The ELF file of an image that tells the stack of its functions."""
    flags = {"RUSTC_BOOTSTRAP": "1", "CARGO_ENCODED_RUSTFLAGS": "-Zemit-stack-sizes"}
    subprocess.run(["cargo", "build", "--quiet", "--package", "tvc-nano", "--bin", "tvc-nano", "--profile", "firmware",
                    "--target", TARGET, "--target-dir", folder], check=True, cwd=ROOT, env=os.environ | flags)
    return Path(folder) / TARGET / "firmware" / "tvc-nano"


def section(elf, wanted):
    """The bytes of the sections of a name, of a 32-bit little-endian ELF file."""
    offset, = struct.unpack_from("<I", elf, 0x20)
    size, count, names = struct.unpack_from("<HHH", elf, 0x2E)
    headers = [struct.unpack_from("<10I", elf, offset + size * index) for index in range(count)]
    base = headers[names][4]
    name = lambda header: elf[base + header[0]:elf.index(0, base + header[0])].decode()
    return b"".join(elf[header[4]:header[4] + header[5]] for header in headers if name(header) == wanted)


def stack_sizes(data):
    """Bytes by address: words, each with a number in LEB128 behind it."""
    sizes, at = {}, 0
    while at + 5 <= len(data):
        address, = struct.unpack_from("<I", data, at)
        at, number, shift = at + 4, 0, 0
        while True:
            byte = data[at]
            number, shift, at = number | (byte & 127) << shift, shift + 7, at + 1
            if byte < 128:
                break
        sizes[address & ~1] = number
    return sizes


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else ROOT / "target" / "stack-sizes"
    image = build(Path(folder).resolve())
    told = stack_sizes(section(image.read_bytes(), ".stack_sizes"))
    lab = ["cargo", "lab", "stack", "--image", str(image), "--json"]
    found = json.loads(subprocess.run(lab, cwd=ROOT, stdout=subprocess.PIPE).stdout)["largest"]
    same, different, untold = 0, [], 0
    for function in found:
        size = told.get(int(function["at"], 16))
        if size is None:
            untold += 1
        elif size == function["own_bytes"]:
            same += 1
        else:
            different.append(f"{function['function']}: {function['own_bytes']} bytes, {size} by the compiler")
    print(f"{same} functions have the stack that the compiler says, {len(different)} another; of {untold} it says nothing")
    print(*different, sep="\n", end="\n" if different else "")
    return 0 if same and not different else 1


if __name__ == "__main__":
    sys.exit(main())
