#!/usr/bin/env python3
"""Runs random ARMv6-M programs on the emulated core and on an independent one, and compares.

    pip install unicorn
    python3 samd21/tools/differential.py --sequences 100000 --seed 1

The independent core is Unicorn (QEMU's Cortex-M0). A program is grown instruction by instruction:
each is chosen with the registers known that Unicorn has reached, so that loads and stores of every
addressing mode hit memory and branches of every kind land in free code space, in flash or in SRAM.
Then the emulated core runs the whole program from the same start, and R0 to R15, N, Z, C, V,
PRIMASK, CONTROL, MSP, PSP, the number of instructions and all 32 KB of SRAM must be equal. SRAM goes
on from program to program, so a difference cannot be overwritten unseen.

Every encoding (conditions taken and not taken, special registers one by one) is counted; one that
was never executed fails the run. So does, from 10,000 programs on, a value of the upper 10 bits of a
16-bit encoding that was never executed: these bits distinguish all 16-bit encodings.
`--vectors FILE` stores the programs and their outcome for `cargo test -p samd21`.

Not compared, but tested by hand in samd21/tests/: exceptions, SVC, BKPT, UDF, WFI, WFE, faults,
cycles. Where Unicorn differs from the architecture, programs avoid the difference:
- it stops at YIELD, which is a NOP here: tested by hand;
- it has the Q flag, which ARMv6-M does not have: MSR to APSR gets values with bit 27 clear;
- it has unprivileged mode and floating-point state, which this chip does not have: MSR to CONTROL
  gets values with bits 0, 2 and 3 clear;
- it keeps bits 1:0 of stack pointers, which do not exist: they get aligned values.
What ARM calls unpredictable is never generated.
"""

import argparse
import collections
import multiprocessing
import os
import pathlib
import random
import struct
import subprocess
import sys

from unicorn import UC_ARCH_ARM, UC_MODE_MCLASS, UC_MODE_THUMB, UC_PROT_EXEC, UC_PROT_READ, Uc, UcError
from unicorn import arm_const as arm

RAM, RAM_SIZE = 0x2000_0000, 0x8000
FLASH_SIZE = 0x4_0000
# Code space: three places in flash, two of them in reach of B, all of BL; one in SRAM. Literals fill
# them from above.
AREA_BYTES, LITERAL_BYTES = 0x400, 0x100
AREAS = (0x1000, 0x1500, 0x2_F000, RAM + 0x6000)
# Constant data in flash: a copy of the noise that SRAM starts with.
FLASH_DATA = 0x1_0000
# The longest generated group of instructions, in half-words.
GROUP = 8
STEPS = (6, 18)

CONDITIONS = "EQ NE CS CC MI PL VS VC HI LS GE LT GT LE".split()
SPECIAL = {"APSR": 0, "IAPSR": 1, "EAPSR": 2, "XPSR": 3, "IPSR": 5, "EPSR": 6, "IEPSR": 7,
           "MSP": 8, "PSP": 9, "PRIMASK": 16, "CONTROL": 20}
SP, LR, PC = 13, 14, 15
NOP, BKPT = 0xBF00, 0xBE00
EDGES = (0, 1, 2, 31, 32, 33, 255, 256, 0x7FFF, 0x8000, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF)
MASK = 0xFFFF_FFFF

UC_REGISTERS = ([arm.UC_ARM_REG_R0 + i for i in range(13)]
                + [arm.UC_ARM_REG_SP, arm.UC_ARM_REG_LR, arm.UC_ARM_REG_PC])
# Upper 10 bits of all 16-bit encodings but BKPT, SVC and UDF; two patterns are wholly unpredictable: CMP
# of two low registers in the high form (0x114), STM of R6 and R7 with base R7 (0x31F).
PATTERNS = {*range(0x000, 0x114), *range(0x115, 0x2C4), *range(0x2C8, 0x2CC), *range(0x2D0, 0x2D8), 0x2D9, 0x2E8, 0x2E9, 0x2EB,
            *range(0x2F0, 0x2F8), 0x2FC, 0x2FD, *range(0x300, 0x31F), *range(0x320, 0x378), *range(0x380, 0x3A0)}
OUTCOME = struct.Struct("<23I")


def noise(seed, size=RAM_SIZE):
    """What SRAM holds at power-on (SplitMix64), as in samd21/src/memory.rs."""
    out, state, mask = bytearray(), seed, (1 << 64) - 1
    while len(out) < size:
        state = (state + 0x9E37_79B9_7F4A_7C15) & mask
        z = state
        z = ((z ^ z >> 30) * 0xBF58_476D_1CE4_E5B9) & mask
        z = ((z ^ z >> 27) * 0x94D0_49BB_1331_11EB) & mask
        out += (z ^ z >> 31).to_bytes(8, "little")
    return bytes(out)


def fnv1a(data):
    """64-bit FNV-1a: stands for SRAM in the stored vectors."""
    hash_ = 0xCBF2_9CE4_8422_2325
    for byte in data:
        hash_ = (hash_ ^ byte) * 0x100_0000_01B3 & 0xFFFF_FFFF_FFFF_FFFF
    return hash_


class Instruction:
    """Half-words, the name they are counted under, and the registers they write."""

    def __init__(self, name, *half_words, writes=(), branch=False):
        self.name, self.half_words, self.writes, self.branch = name, half_words, writes, branch


class Program:
    """Grows one random program on Unicorn, which keeps its SRAM from program to program."""

    def __init__(self, rng, seed):
        self.rng = rng
        self.uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M0)
        self.uc.mem_map(0, FLASH_SIZE, UC_PROT_READ | UC_PROT_EXEC)
        self.uc.mem_map(RAM, RAM_SIZE)
        start = noise(seed)
        self.uc.mem_write(RAM, start)
        self.uc.mem_write(0, b"\xFF" * FLASH_SIZE)
        self.uc.mem_write(FLASH_DATA, start)
        self.coverage = collections.Counter()
        self.patterns = set()
        self.encodings = dict(self.encoders())
        self.names = list(self.encodings)

    # Values and places.

    def value(self):
        rng, kind = self.rng, self.rng.random()
        if kind < 0.35:
            return self.address()
        if kind < 0.55:
            return rng.randrange(256)
        if kind < 0.7:
            return rng.choice(EDGES)
        return rng.getrandbits(32)

    def address(self):
        base = RAM if self.rng.random() < 0.8 else FLASH_DATA
        address = base + self.rng.randrange(0x5C00)
        return address & ~3 if self.rng.random() < 0.8 else address

    def stack_address(self):
        return RAM + 0x6800 + 4 * self.rng.randrange(0x500)

    def may_store(self, address, size=4):
        return (RAM <= address and address + size <= RAM + RAM_SIZE
                and not (AREAS[-1] - size < address < AREAS[-1] + AREA_BYTES))

    def may_load(self, address, size=4):
        return self.may_store(address, size) or FLASH_DATA <= address <= FLASH_DATA + RAM_SIZE - size

    def area(self, address):
        return next(base for base in AREAS if base <= address < base + AREA_BYTES)

    def is_free(self, address):
        """Whether a group of instructions can start here."""
        return any(base <= address and address + 2 * GROUP <= self.pool[base]
                   for base in AREAS) and not self.used.intersection(range(address, address + 2 * GROUP, 2))

    def target(self, low, high):
        """A free place between two addresses."""
        for _ in range(6):
            base = self.rng.choice([base for base in AREAS if base <= high and low < base + AREA_BYTES])
            span = range(max(low, base), min(high, base + AREA_BYTES - LITERAL_BYTES - 2 * GROUP) + 1)
            if len(span):
                address = self.rng.choice(span) & ~1
                if address >= low and self.is_free(address) and abs(address - self.pc) >= 2 * GROUP:
                    # Unicorn looks at what follows a branch before it stops there.
                    self.poke(address, NOP)
                    return address
        return None

    def anywhere(self):
        return self.target(0, RAM + RAM_SIZE)

    def poke(self, address, half_word):
        self.uc.mem_write(address, half_word.to_bytes(2, "little"))
        self.writes.append((address, half_word))

    def low(self):
        return self.rng.randrange(8)

    def literal(self, pc, register, value):
        """LDR register, =value for the instruction at `pc`."""
        base = self.area(pc)
        self.pool[base] -= 4
        slot = self.pool[base]
        self.poke(slot, value & 0xFFFF)
        self.poke(slot + 2, value >> 16)
        offset = slot - (pc + 4 & ~3)
        return Instruction("LDR literal", 0x4800 | register << 8 | offset // 4, writes=(register,))

    # One encoder for each encoding: a list of instructions to be executed at self.pc one after the
    # other, or None where the registers do not allow it now.

    def encoders(self):
        for i, name in enumerate(("LSL", "LSR", "ASR")):
            yield name + " imm5", self.low_form(i << 11, 11)
        for i, name in enumerate(("ADD reg", "SUB reg", "ADD imm3", "SUB imm3")):
            yield name, self.low_form(0x1800 | i << 9, 9)
        for i, name in enumerate(("MOV imm8", "CMP imm8", "ADD imm8", "SUB imm8")):
            yield name, self.imm8_form(0x2000 | i << 11, name.startswith("CMP"))
        for i, name in enumerate("AND EOR LSL LSR ASR ADC SBC ROR TST RSB CMP CMN ORR MUL BIC MVN".split()):
            yield name + " reg", self.low_form(0x4000 | i << 6, 6, name in ("TST", "CMP", "CMN"))
        for name, opcode in (("SXTH", 0xB200), ("SXTB", 0xB240), ("UXTH", 0xB280), ("UXTB", 0xB2C0),
                             ("REV", 0xBA00), ("REV16", 0xBA40), ("REVSH", 0xBAC0)):
            yield name, self.low_form(opcode, 6)
        yield "ADD high", self.add_high
        yield "ADD SP reg", self.add_sp_register
        yield "ADD PC reg", self.add_pc
        yield "CMP high", self.cmp_high
        yield "MOV high", self.mov_high
        yield "MOV SP reg", self.mov_sp
        yield "MOV PC reg", self.mov_pc
        yield "BX", self.branch_register("BX", 0x4700, ())
        yield "BLX", self.branch_register("BLX", 0x4780, (LR,))
        yield "LDR literal", lambda: [self.literal(self.pc, self.low(), self.value())]
        for i, (name, size) in enumerate((("STR", 4), ("STRH", 2), ("STRB", 1), ("LDRSB", 1),
                                          ("LDR", 4), ("LDRH", 2), ("LDRB", 1), ("LDRSH", 2))):
            yield name + " reg", self.register_offset(name, 0x5000 | i << 9, size)
        for i, (name, size) in enumerate((("STR", 4), ("LDR", 4), ("STRB", 1), ("LDRB", 1),
                                          ("STRH", 2), ("LDRH", 2))):
            yield name + " imm5", self.immediate_offset(name, 0x6000 + (i << 11), size)
        yield "STR SP", self.sp_offset("STR", 0x9000)
        yield "LDR SP", self.sp_offset("LDR", 0x9800)
        yield "ADR", self.imm8_form(0xA000, False)
        yield "ADD Rd SP", self.imm8_form(0xA800, False)
        yield "ADD SP imm7", self.move_sp("ADD SP imm7", 0xB000, 1)
        yield "SUB SP imm7", self.move_sp("SUB SP imm7", 0xB080, -1)
        yield "PUSH", self.push("PUSH", 0)
        yield "PUSH LR", self.push("PUSH LR", 0x100)
        yield "POP", self.pop
        yield "POP PC", self.pop_pc
        yield "STM", self.stm
        yield "LDM", self.ldm("LDM", False)
        yield "LDM base in list", self.ldm("LDM base in list", True)
        for name, opcode in (("CPSIE", 0xB662), ("CPSID", 0xB672), ("NOP", 0xBF00), ("SEV", 0xBF40),
                             ("hint not allocated", 0xBF70)):
            yield name, self.fixed(name, opcode)
        for name, option in (("DSB", 4), ("DMB", 5), ("ISB", 6)):
            yield name, self.fixed(name, 0xF3BF, 0x8F0F | option << 4)
        for number, condition in enumerate(CONDITIONS):
            yield "B" + condition, self.branch_if("B" + condition, 0xD000 | number << 8)
        yield "B", self.branch
        yield "BL", self.branch_link
        for name, number in SPECIAL.items():
            yield "MRS " + name, self.mrs("MRS " + name, number)
            yield "MSR " + name, self.msr("MSR " + name, number)

    def fixed(self, name, *half_words):
        return lambda: [Instruction(name, *half_words)]

    def low_form(self, opcode, free_bits, compares=False):
        """Rd in bits 2:0, everything else below `free_bits` at random."""
        def encode():
            op = opcode | self.rng.getrandbits(free_bits)
            return [Instruction(None, op, writes=() if compares else (op & 7,))]
        return encode

    def imm8_form(self, opcode, compares):
        def encode():
            rd = self.low()
            op = opcode | rd << 8 | self.rng.getrandbits(8)
            return [Instruction(None, op, writes=() if compares else (rd,))]
        return encode

    @staticmethod
    def high(opcode, rd, rm):
        return opcode | (rd & 8) << 4 | rm << 3 | rd & 7

    def add_high(self):
        rd, rm = self.rng.choice([*range(13), LR]), self.rng.randrange(16)
        return [Instruction(None, self.high(0x4400, rd, rm), writes=(rd,))]

    def add_sp_register(self):
        rm = self.rng.randrange(13)
        sp = self.r[SP] + self.r[rm] & MASK
        if not sp % 4 and self.may_store(sp):
            return [Instruction(None, self.high(0x4400, SP, rm), writes=(SP,))]
        rm, offset = self.low(), 4 * self.rng.randrange(-16, 17)
        if not self.may_store(self.r[SP] + offset):
            return None
        return [self.literal(self.pc, rm, offset & MASK), Instruction(None, self.high(0x4400, SP, rm), writes=(SP,))]

    def add_pc(self):
        target = self.anywhere()
        if target is None:
            return None
        rm = self.low()
        offset = target + self.rng.randrange(2) - (self.pc + 6) & MASK
        return [self.literal(self.pc, rm, offset), Instruction(None, self.high(0x4400, PC, rm), branch=True)]

    def cmp_high(self):
        rn, rm = self.rng.randrange(15), self.rng.randrange(15)
        return None if rn < 8 and rm < 8 else [Instruction(None, self.high(0x4500, rn, rm))]

    def mov_high(self):
        rd, rm = self.rng.choice([*range(13), LR]), self.rng.randrange(16)
        return [Instruction(None, self.high(0x4600, rd, rm), writes=(rd,))]

    def mov_sp(self):
        rm = self.low()
        return [self.literal(self.pc, rm, self.stack_address()), Instruction(None, self.high(0x4600, SP, rm), writes=(SP,))]

    def mov_pc(self):
        return self.via_register(lambda rm: Instruction(None, self.high(0x4600, PC, rm), branch=True), self.rng.randrange(2))

    def branch_register(self, name, opcode, writes):
        return lambda: self.via_register(
            lambda rm: Instruction(name, opcode | rm << 3, writes=writes, branch=True), 1)

    def via_register(self, branch, bit0):
        """Loads a target into a low register, perhaps moves it to a high one, branches."""
        target = self.anywhere()
        if target is None:
            return None
        rm = self.low()
        group = [self.literal(self.pc, rm, target | bit0)]
        if self.rng.random() < 0.5:
            high = self.rng.choice([8, 9, 10, 11, 12, LR])
            group.append(Instruction("MOV high", self.high(0x4600, high, rm), writes=(high,)))
            rm = high
        return group + [branch(rm)]

    def register_offset(self, name, opcode, size):
        allowed = self.may_store if name.startswith("STR") else self.may_load

        def encode():
            pairs = [(rn, rm) for rn in range(8) for rm in range(8)
                     if not (address := self.r[rn] + self.r[rm] & MASK) % size and allowed(address, size)]
            if not pairs:
                return None
            rt, (rn, rm) = self.low(), self.rng.choice(pairs)
            writes = () if name.startswith("STR") else (rt,)
            return [Instruction(name + " reg", opcode | rm << 6 | rn << 3 | rt, writes=writes)]
        return encode

    def immediate_offset(self, name, opcode, size):
        allowed = self.may_store if name.startswith("STR") else self.may_load

        def encode():
            offset = self.rng.randrange(32)
            bases = [rn for rn in range(8)
                     if not (address := self.r[rn] + size * offset) % size and allowed(address, size)]
            if not bases:
                return None
            rt, rn = self.low(), self.rng.choice(bases)
            writes = () if name.startswith("STR") else (rt,)
            return [Instruction(name + " imm5", opcode | offset << 6 | rn << 3 | rt, writes=writes)]
        return encode

    def sp_offset(self, name, opcode):
        def encode():
            offset, rt = self.rng.randrange(256), self.low()
            if not self.may_store(self.r[SP] + 4 * offset):
                return None
            writes = () if name == "STR" else (rt,)
            return [Instruction(name + " SP", opcode | rt << 8 | offset, writes=writes)]
        return encode

    def move_sp(self, name, opcode, sign):
        def encode():
            words = self.rng.randrange(128)
            if not self.may_store(self.r[SP] + 4 * sign * words):
                return None
            return [Instruction(name, opcode | words, writes=(SP,))]
        return encode

    def registers(self, least=1):
        while True:
            list_ = self.rng.getrandbits(8) & self.rng.choice((0xFF, self.rng.getrandbits(8)))
            if list_.bit_count() >= least:
                return list_

    @staticmethod
    def members(list_):
        return tuple(i for i in range(8) if list_ >> i & 1)

    def push(self, name, lr):
        def encode():
            list_ = self.registers(0 if lr else 1)
            bytes_ = 4 * (list_.bit_count() + bool(lr))
            if not self.may_store(self.r[SP] - bytes_, bytes_):
                return None
            return [Instruction(name, 0xB400 | lr | list_, writes=(SP,))]
        return encode

    def pop(self):
        list_ = self.registers()
        if not self.may_store(self.r[SP], 4 * list_.bit_count() + 4):
            return None
        return [Instruction("POP", 0xBC00 | list_, writes=(SP, *self.members(list_)))]

    def pop_pc(self):
        list_, target, rt = self.registers(0), self.anywhere(), self.low()
        words = list_.bit_count()
        if target is None or not self.may_store(self.r[SP], 4 * words + 8):
            return None
        return [self.literal(self.pc, rt, target | 1),
                Instruction("STR SP", 0x9000 | rt << 8 | words),
                Instruction("POP PC", 0xBD00 | list_, writes=(SP, *self.members(list_)), branch=True)]

    def stm(self):
        list_ = self.registers()
        size = 4 * list_.bit_count()
        lowest = self.members(list_)[0]
        bases = [rn for rn in range(8) if not self.r[rn] % 4 and self.may_store(self.r[rn], size)
                 and (rn == lowest or not list_ >> rn & 1)]
        if not bases:
            return None
        rn = self.rng.choice(bases)
        return [Instruction("STM", 0xC000 | rn << 8 | list_, writes=(rn,))]

    def ldm(self, name, with_base):
        def encode():
            list_ = self.registers()
            size = 4 * list_.bit_count()
            bases = [rn for rn in range(8) if not self.r[rn] % 4 and self.may_load(self.r[rn], size)
                     and bool(list_ >> rn & 1) == with_base]
            if not bases:
                return None
            rn = self.rng.choice(bases)
            return [Instruction(name, 0xC800 | rn << 8 | list_, writes=(rn, *self.members(list_)))]
        return encode

    def branch_if(self, name, opcode):
        def encode():
            target = self.target(self.pc + 4 - 256, self.pc + 4 + 254)
            if target is None:
                return None
            return [Instruction(name, opcode | (target - self.pc - 4 >> 1) & 0xFF, branch=True)]
        return encode

    def branch(self):
        target = self.target(self.pc + 4 - 2048, self.pc + 4 + 2046)
        if target is None:
            return None
        return [Instruction("B", 0xE000 | (target - self.pc - 4 >> 1) & 0x7FF, branch=True)]

    def branch_link(self):
        low, high = (0, FLASH_SIZE) if self.pc < FLASH_SIZE else (AREAS[-1], RAM + RAM_SIZE)
        target = self.target(low, high)
        if target is None:
            return None
        offset = target - self.pc - 4
        s = int(offset < 0)
        i1, i2 = offset >> 23 & 1, offset >> 22 & 1
        first = 0xF000 | s << 10 | offset >> 12 & 0x3FF
        second = 0xD000 | (i1 ^ s ^ 1) << 13 | (i2 ^ s ^ 1) << 11 | offset >> 1 & 0x7FF
        return [Instruction("BL", first, second, writes=(LR,), branch=True)]

    def mrs(self, name, number):
        def encode():
            rd = self.rng.choice([*range(13), LR])
            return [Instruction(name, 0xF3EF, 0x8000 | rd << 8 | number, writes=(rd,))]
        return encode

    def msr(self, name, number):
        def encode():
            rn = self.low()
            group = []
            if number in (SPECIAL["MSP"], SPECIAL["PSP"]):
                group = [self.literal(self.pc, rn, self.stack_address())]
            elif number == SPECIAL["CONTROL"] and self.r[rn] & 13 or number < 4 and self.r[rn] >> 27 & 1:
                return None
            return group + [Instruction(name, 0xF380 | rn, 0x8800 | number, writes=(SP,))]
        return encode

    # Growing and running.

    def run(self):
        """Grows and runs a program; its case for the emulated core and its outcome."""
        self.writes, self.used, self.steps = [], set(), 0
        self.pool = {base: base + AREA_BYTES for base in AREAS}
        self.pc = AREAS[0] - 2 * GROUP
        self.pc = self.anywhere()
        uc, rng = self.uc, self.rng
        msp, psp = self.stack_address(), self.stack_address()
        control, primask = 2 * rng.randrange(2), rng.randrange(2)
        flags = rng.getrandbits(4) << 28
        self.r = [self.value() for _ in range(13)] + [psp if control else msp, self.value(), self.pc]
        uc.reg_write(arm.UC_ARM_REG_CONTROL, 0)
        uc.reg_write(arm.UC_ARM_REG_MSP, msp)
        uc.reg_write(arm.UC_ARM_REG_PSP, psp)
        uc.reg_write(arm.UC_ARM_REG_CONTROL, control)
        uc.reg_write(arm.UC_ARM_REG_PRIMASK, primask)
        uc.reg_write(arm.UC_ARM_REG_APSR_NZCVQ, flags)
        for register in (*range(13), LR):
            uc.reg_write(UC_REGISTERS[register], self.r[register])
        start = self.state()
        length = rng.randrange(*STEPS)
        while self.steps < length:
            self.grow()
        self.poke(self.pc, BKPT)
        outcome = self.state()
        case = struct.pack("<I", len(self.writes))
        case += b"".join(struct.pack("<IH", *write) for write in self.writes)
        return case + OUTCOME.pack(*start, 0, 0), OUTCOME.pack(*outcome, self.steps, 0)

    def state(self):
        uc = self.uc
        return ([uc.reg_read(register) for register in UC_REGISTERS[:15]] + [self.pc]
                + [uc.reg_read(arm.UC_ARM_REG_XPSR) & 0xF000_0000]
                + [uc.reg_read(register) for register in (
                    arm.UC_ARM_REG_PRIMASK, arm.UC_ARM_REG_CONTROL, arm.UC_ARM_REG_MSP, arm.UC_ARM_REG_PSP)])

    def grow(self):
        """Adds one group of instructions and executes it."""
        while True:
            name = self.rng.choice(self.names)
            group = self.encodings[name]()
            if group is not None:
                break
        for instruction in group:
            self.step(instruction, name)
        if not self.is_free(self.pc):
            # The room ends here: on to another place.
            while (group := self.branch()) is None:
                pass
            self.step(group[0], "B")

    def step(self, instruction, group_name):
        uc, pc = self.uc, self.pc
        end = pc + 2 * len(instruction.half_words)
        for address, half_word in zip(range(pc, end, 2), instruction.half_words):
            self.poke(address, half_word)
            self.used.add(address)
        if instruction.branch:
            self.poke(end, NOP)
        uc.ctl_remove_cache(pc, end)
        try:
            uc.emu_start(pc | 1, 0 if instruction.branch else end, count=1 if instruction.branch else 0)
        except UcError as error:
            words = " ".join(f"{half_word:04x}" for half_word in instruction.half_words)
            raise RuntimeError(f"{group_name} ({words}) at 0x{pc:08x}: {error}") from error
        self.steps += 1
        self.pc = uc.reg_read(arm.UC_ARM_REG_PC) if instruction.branch else end
        for register in instruction.writes:
            self.r[register] = uc.reg_read(UC_REGISTERS[register])
        self.r[PC] = self.pc
        self.patterns.add(instruction.half_words[0] >> 6)
        name = instruction.name or group_name
        if name[1:] in CONDITIONS and name[0] == "B":
            name += " not taken" if self.pc == end else " taken"
        self.coverage[name] += 1

    def expected(self):
        """All names that the coverage must have."""
        for name in self.names:
            if name[0] == "B" and name[1:] in CONDITIONS:
                yield name + " taken"
                yield name + " not taken"
            else:
                yield name


def difference(want, got, want_ram, got_ram):
    names = [f"r{i}" for i in range(16)] + ["flags", "primask", "control", "msp", "psp", "instructions", "stop"]
    for name, one, other in zip(names, OUTCOME.unpack(want), OUTCOME.unpack(got)):
        if one != other:
            yield f"{name}: Unicorn 0x{one:08x}, emulated core 0x{other:08x}"
    for offset, (one, other) in enumerate(zip(want_ram, got_ram)):
        if one != other:
            yield f"0x{RAM + offset:08x}: Unicorn 0x{one:02x}, emulated core 0x{other:02x}"


def work(runner, seed, sequences, vectors, shared):
    """Runs `sequences` programs in this process; the coverage and the instructions executed."""
    program = Program(random.Random(seed), seed)
    core = subprocess.Popen([runner, str(seed)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    executed = 0
    for number in range(sequences):
        case, want = program.run()
        core.stdin.write(case)
        core.stdin.flush()
        want_ram = bytes(program.uc.mem_read(RAM, RAM_SIZE))
        got = core.stdout.read(OUTCOME.size)
        got_ram = core.stdout.read(RAM_SIZE)
        if len(got_ram) != RAM_SIZE:
            raise RuntimeError(f"the emulated core ended in program {number} of seed {seed}")
        if want != got or want_ram != got_ram:
            lines = [f"program {number} of seed {seed} differs:", *difference(want, got, want_ram, got_ram)]
            lines += [f"  0x{address:08x}: {half_word:04x}" for address, half_word in sorted(program.writes)]
            raise RuntimeError("\n".join(lines[:80]))
        if vectors is not None:
            vectors.append(case + want + struct.pack("<Q", fnv1a(want_ram)))
        executed += program.steps
        with shared.get_lock():
            shared.value += 1
    core.stdin.close()
    core.wait()
    return program.coverage, executed, list(program.expected()), program.patterns


def child(arguments):
    try:
        return work(*arguments, SHARED)
    except RuntimeError as error:
        return str(error)


def adopt(shared):
    global SHARED
    SHARED = shared


def build():
    """Builds the emulated core's side and returns the path of the program."""
    root = pathlib.Path(__file__).resolve().parents[2]
    command = ["cargo", "build", "--release", "--quiet", "--package", "samd21", "--example", "differential"]
    subprocess.run(command, cwd=root, check=True)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", root / "target"))
    return str(target / "release" / "examples" / "differential")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", type=int, default=100_000, help="random programs (100000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--vectors", type=pathlib.Path, help="store the programs and outcomes here")
    parser.add_argument("--coverage", action="store_true", help="print how often each encoding was executed")
    parser.add_argument("--runner", help="the built example `differential` (default: build it)")
    options = parser.parse_args()
    runner = options.runner or build()
    shared = multiprocessing.Value("q", 0)
    if options.vectors:
        adopt(shared)
        stored = []
        outcomes = [work(runner, options.seed, options.sequences, stored, shared)]
    else:
        share = [options.sequences // options.jobs + (i < options.sequences % options.jobs)
                 for i in range(options.jobs)]
        arguments = [(runner, options.seed + (i << 32), count, None) for i, count in enumerate(share)]
        with multiprocessing.Pool(options.jobs, adopt, (shared,)) as pool:
            pending = pool.map_async(child, arguments)
            while not pending.ready():
                pending.wait(5)
                print(f"\r{shared.value} of {options.sequences} programs", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
            outcomes = pending.get()
    failures = [outcome for outcome in outcomes if isinstance(outcome, str)]
    if failures:
        sys.exit("\n".join(failures))
    coverage = sum((outcome[0] for outcome in outcomes), collections.Counter())
    missing = [name for name in outcomes[0][2] if not coverage[name]]
    if options.coverage:
        for name in outcomes[0][2]:
            print(f"{coverage[name]:9} {name}")
    patterns = set.union(*(outcome[3] for outcome in outcomes)) & PATTERNS
    if options.sequences >= 10_000:
        missing += [f"{pattern << 6:04x} to {(pattern << 6) + 0x3F:04x}" for pattern in sorted(PATTERNS - patterns)]
    if missing:
        sys.exit("never executed: " + ", ".join(missing))
    if options.vectors:
        options.vectors.parent.mkdir(parents=True, exist_ok=True)
        options.vectors.write_bytes(struct.pack("<QI", options.seed, len(stored)) + b"".join(stored))
    rarest = min(outcomes[0][2], key=coverage.__getitem__)
    print(f"{options.sequences} programs, {sum(outcome[1] for outcome in outcomes)} instructions: registers, flags "
          f"and memory equal; {len(outcomes[0][2])} encodings, the rarest ({rarest}) {coverage[rarest]} times; "
          f"{len(patterns)} of {len(PATTERNS)} patterns of the upper 10 bits")


if __name__ == "__main__":
    main()
