//! A server of the protocol of GDB: registers, memory, breakpoints, single steps, and back.
//!
//! The rig stands still while the debugger looks, and its clock with it: whoever is at its port
//! hears nothing meanwhile. The way back goes over copies of the rig. What other programs have sent
//! since such a copy was made is not sent again.
//!
//! Breakpoints change no flash, so that the image's check of itself holds. Memory that is written
//! is written.

use std::cell::Cell;
use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::net::{TcpListener, TcpStream};

use gdbstub::arch::Arch;
use gdbstub::common::Signal;
use gdbstub::conn::ConnectionExt;
use gdbstub::stub::state_machine::GdbStubStateMachine as Machine;
use gdbstub::stub::{GdbStub, SingleThreadStopReason as StopReason};
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::reverse_exec::{
    ReplayLogPosition, ReverseCont, ReverseContOps, ReverseStep, ReverseStepOps,
};
use gdbstub::target::ext::base::singlethread::{
    SingleThreadBase, SingleThreadResume, SingleThreadResumeOps, SingleThreadSingleStep,
    SingleThreadSingleStepOps,
};
use gdbstub::target::ext::breakpoints::{
    Breakpoints, BreakpointsOps, HwBreakpoint, HwBreakpointOps, SwBreakpoint, SwBreakpointOps,
};
use gdbstub::target::{Target, TargetError, TargetResult};
use samd21::board::Ticks;

use crate::fly::attended::Attended;
use crate::rig::{Rig, RigError};

/// Copies of the rig for the way back, and the time between two.
const COPIES: usize = 64;
const COPY_EVERY: Ticks = Ticks::from_ms(50);
/// A step from sleep takes no longer.
const LONGEST_STEP: Ticks = Ticks::from_ms(1_000);

/// The server. One debugger at a time.
pub struct Server {
    listener: TcpListener,
    session: Option<Machine<'static, Attended, TcpStream>>,
}

/// What a debugger has set at a rig.
#[derive(Default)]
pub(super) struct Debug {
    breakpoints: BTreeSet<u32>,
    resume: Resume,
    /// The rig stands before a breakpoint that it ran into.
    is_at_breakpoint: bool,
    copies: VecDeque<Rig>,
}

/// How the rig goes on.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Resume {
    #[default]
    Run,
    Step,
    StepBack,
    RunBack,
}

impl Server {
    /// Serves whoever connects.
    ///
    /// # Errors
    /// The system does not let it look without waiting.
    pub fn new(listener: TcpListener) -> io::Result<Self> {
        listener.set_nonblocking(true)?;
        Ok(Self { listener, session: None })
    }

    /// Does what the debugger asks for. Whether the rig is to stand still.
    ///
    /// # Errors
    /// The rig stopped in a step.
    pub(super) fn poll(&mut self, attended: &mut Attended) -> Result<bool, RigError> {
        let connected = self.session.take().or_else(|| {
            let (stream, _) = self.listener.accept().ok()?;
            GdbStub::new(stream).run_state_machine(attended).ok()
        });
        let Some(mut machine) = connected else { return Ok(false) };
        // A connection that fails, or is closed, is the end of the session.
        loop {
            let next = match machine {
                Machine::Idle(mut idle) => match next_byte(idle.borrow_conn()) {
                    Ok(Some(byte)) => idle.incoming_data(attended, byte),
                    Ok(None) => {
                        self.session = Some(idle.into());
                        return Ok(true);
                    }
                    Err(_) => break,
                },
                Machine::Running(mut running) => match next_byte(running.borrow_conn()) {
                    Ok(Some(byte)) => running.incoming_data(attended, byte),
                    Ok(None) => match attended.go_on()? {
                        Some(reason) => running.report_stop(attended, reason),
                        None => {
                            self.session = Some(running.into());
                            return Ok(false);
                        }
                    },
                    Err(_) => break,
                },
                Machine::CtrlCInterrupt(interrupted) => {
                    let reason = StopReason::Signal(Signal::SIGINT);
                    interrupted.interrupt_handled(attended, Some(reason))
                }
                Machine::Disconnected(_) => break,
            };
            match next {
                Ok(next) => machine = next,
                Err(_) => break,
            }
        }
        attended.debug = Debug::default();
        Ok(false)
    }
}

/// What has come from the debugger, if anything has.
fn next_byte(stream: &mut TcpStream) -> io::Result<Option<u8>> {
    match ConnectionExt::peek(stream)? {
        Some(_) => ConnectionExt::read(stream).map(Some),
        None => Ok(None),
    }
}

impl Debug {
    /// Lets the rig run for a time, or up to a breakpoint.
    ///
    /// # Errors
    /// The rig stopped.
    pub(super) fn run(&mut self, rig: &mut Rig, time: Ticks) -> Result<(), RigError> {
        if self.breakpoints.is_empty() {
            return rig.run_for(time);
        }
        if self.copies.back().is_none_or(|copy| rig.now() >= copy.now() + COPY_EVERY) {
            self.keep(rig);
        }
        let until = rig.now() + time;
        self.is_at_breakpoint = rig.run_watched(until, &|pc| self.breakpoints.contains(&pc))?;
        Ok(())
    }

    fn keep(&mut self, rig: &Rig) {
        self.copies.push_back(rig.clone());
        if self.copies.len() > COPIES {
            self.copies.pop_front();
        }
    }

    /// Brings the rig back to the last instruction before now, by their number, at which `stops`.
    /// `false`, and nothing is changed, if there is none.
    fn back(&mut self, rig: &mut Rig, stops: impl Fn(u32) -> bool) -> Result<bool, RigError> {
        let executed = |rig: &Rig| rig.chip.counters().instructions;
        let now = executed(rig);
        while let Some(copy) = self.copies.back() {
            let first = executed(copy);
            if first < now {
                // Once to find the last, and once to get there.
                let last = Cell::new(stops(copy.chip.pc()).then_some(first));
                let count = Cell::new(first);
                replay(&mut copy.clone(), &count, now, |pc| {
                    if stops(pc) {
                        last.set(Some(count.get()));
                    }
                })?;
                if let Some(last) = last.get() {
                    *rig = copy.clone();
                    count.set(first);
                    return replay(rig, &count, last, |_| ()).map(|()| true);
                }
            }
            self.copies.pop_back();
        }
        Ok(false)
    }
}

/// Runs a rig until this number of instructions is executed. `count` counts them, and `each` gets
/// the address of every instruction from the second on.
fn replay(
    rig: &mut Rig,
    count: &Cell<u64>,
    until: u64,
    each: impl Fn(u32),
) -> Result<(), RigError> {
    if count.get() >= until {
        return Ok(());
    }
    let stops = |pc| {
        count.set(count.get() + 1);
        let is_there = count.get() >= until;
        if !is_there {
            each(pc);
        }
        is_there
    };
    while !rig.run_watched(rig.now() + LONGEST_STEP, &stops)? {}
    Ok(())
}

impl Attended {
    /// Does a step, or the way back; says why the rig stands still now, if it does.
    fn go_on(&mut self) -> Result<Option<StopReason<u32>>, RigError> {
        let (rig, debug) = (&mut self.rig, &mut self.debug);
        let arrived = |is_there| match is_there {
            true => StopReason::SwBreak(()),
            false => StopReason::ReplayLog { tid: None, pos: ReplayLogPosition::Begin },
        };
        let reason = match std::mem::take(&mut debug.resume) {
            Resume::Run if std::mem::take(&mut debug.is_at_breakpoint) => StopReason::SwBreak(()),
            Resume::Run => return Ok(None),
            Resume::Step => {
                debug.keep(rig);
                rig.run_watched(rig.now() + LONGEST_STEP, &|_| true)?;
                StopReason::DoneStep
            }
            Resume::StepBack => match debug.back(rig, |_| true)? {
                true => StopReason::DoneStep,
                false => arrived(false),
            },
            Resume::RunBack => {
                let breakpoints = debug.breakpoints.clone();
                arrived(debug.back(rig, |pc| breakpoints.contains(&pc))?)
            }
        };
        Ok(Some(reason))
    }
}

/// A Cortex-M0+ as GDB describes it.
pub enum CortexM {}

impl Arch for CortexM {
    type Usize = u32;
    type Registers = Registers;
    type RegId = ();
    type BreakpointKind = usize;

    fn target_description_xml() -> Option<&'static str> {
        Some(
            r#"<?xml version="1.0"?><!DOCTYPE target SYSTEM "gdb-target.dtd">
<target version="1.0"><architecture>armv6s-m</architecture>
<feature name="org.gnu.gdb.arm.m-profile">
<reg name="r0" bitsize="32"/><reg name="r1" bitsize="32"/><reg name="r2" bitsize="32"/>
<reg name="r3" bitsize="32"/><reg name="r4" bitsize="32"/><reg name="r5" bitsize="32"/>
<reg name="r6" bitsize="32"/><reg name="r7" bitsize="32"/><reg name="r8" bitsize="32"/>
<reg name="r9" bitsize="32"/><reg name="r10" bitsize="32"/><reg name="r11" bitsize="32"/>
<reg name="r12" bitsize="32"/><reg name="sp" bitsize="32" type="data_ptr"/>
<reg name="lr" bitsize="32"/><reg name="pc" bitsize="32" type="code_ptr"/>
<reg name="xpsr" bitsize="32"/>
</feature></target>"#,
        )
    }
}

/// R0 to R12, SP, LR, PC, xPSR.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Registers([u32; 17]);

impl gdbstub::arch::Registers for Registers {
    type ProgramCounter = u32;

    fn pc(&self) -> u32 {
        self.0[15]
    }

    fn gdb_serialize(&self, write_byte: impl FnMut(Option<u8>)) {
        self.0.iter().flat_map(|word| word.to_le_bytes()).map(Some).for_each(write_byte);
    }

    fn gdb_deserialize(&mut self, bytes: &[u8]) -> Result<(), ()> {
        let (words, []) = bytes.as_chunks::<4>() else { return Err(()) };
        let words: [[u8; 4]; 17] = words.try_into().map_err(drop)?;
        self.0 = words.map(u32::from_le_bytes);
        Ok(())
    }
}

impl Target for Attended {
    type Arch = CortexM;
    type Error = RigError;

    fn base_ops(&mut self) -> BaseOps<'_, CortexM, RigError> {
        BaseOps::SingleThread(self)
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadBase for Attended {
    fn read_registers(&mut self, registers: &mut Registers) -> TargetResult<(), Self> {
        let core = self.rig.chip.registers();
        registers.0[..16].copy_from_slice(&core.r);
        registers.0[16] = core.xpsr;
        Ok(())
    }

    fn write_registers(&mut self, registers: &Registers) -> TargetResult<(), Self> {
        let mut core = self.rig.chip.registers();
        core.r.copy_from_slice(&registers.0[..16]);
        core.xpsr = registers.0[16];
        *(if core.spsel { &mut core.psp } else { &mut core.msp }) = registers.0[13];
        self.rig.chip.set_registers(&core);
        Ok(())
    }

    fn read_addrs(&mut self, from: u32, bytes: &mut [u8]) -> TargetResult<usize, Self> {
        let Rig { chip, environment, .. } = &mut self.rig;
        let mut read = 0;
        for (address, byte) in (from..).zip(bytes) {
            let word = chip.memory.read_u32(address & !3);
            let word = word.or_else(|| chip.peek(address & !3, environment));
            let Some(word) = word else { break };
            *byte = word.to_le_bytes()[(address & 3) as usize];
            read += 1;
        }
        if read == 0 { Err(TargetError::Errno(EFAULT)) } else { Ok(read) }
    }

    fn write_addrs(&mut self, from: u32, bytes: &[u8]) -> TargetResult<(), Self> {
        let chip = &mut self.rig.chip;
        if let Some(ram) = chip.memory.ram_bytes_mut(from, bytes.len()) {
            ram.copy_from_slice(bytes);
        } else if chip.memory.bytes(from, bytes.len()).is_some() {
            chip.load_flash(from, bytes);
        } else {
            return Err(TargetError::Errno(EFAULT));
        }
        Ok(())
    }

    fn support_resume(&mut self) -> Option<SingleThreadResumeOps<'_, Self>> {
        Some(self)
    }
}

/// No such address.
const EFAULT: u8 = 14;

impl SingleThreadResume for Attended {
    fn resume(&mut self, _signal: Option<Signal>) -> Result<(), RigError> {
        self.debug.resume = Resume::Run;
        Ok(())
    }

    fn support_single_step(&mut self) -> Option<SingleThreadSingleStepOps<'_, Self>> {
        Some(self)
    }

    fn support_reverse_step(&mut self) -> Option<ReverseStepOps<'_, (), Self>> {
        Some(self)
    }

    fn support_reverse_cont(&mut self) -> Option<ReverseContOps<'_, (), Self>> {
        Some(self)
    }
}

impl SingleThreadSingleStep for Attended {
    fn step(&mut self, _signal: Option<Signal>) -> Result<(), RigError> {
        self.debug.resume = Resume::Step;
        Ok(())
    }
}

impl ReverseStep<()> for Attended {
    fn reverse_step(&mut self, _thread: ()) -> Result<(), RigError> {
        self.debug.resume = Resume::StepBack;
        Ok(())
    }
}

impl ReverseCont<()> for Attended {
    fn reverse_cont(&mut self) -> Result<(), RigError> {
        self.debug.resume = Resume::RunBack;
        Ok(())
    }
}

impl Breakpoints for Attended {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_breakpoint(&mut self) -> Option<HwBreakpointOps<'_, Self>> {
        Some(self)
    }
}

impl SwBreakpoint for Attended {
    fn add_sw_breakpoint(&mut self, address: u32, _bytes: usize) -> TargetResult<bool, Self> {
        Ok(self.debug.breakpoints.insert(address))
    }

    fn remove_sw_breakpoint(&mut self, address: u32, _bytes: usize) -> TargetResult<bool, Self> {
        Ok(self.debug.breakpoints.remove(&address))
    }
}

impl HwBreakpoint for Attended {
    fn add_hw_breakpoint(&mut self, address: u32, bytes: usize) -> TargetResult<bool, Self> {
        self.add_sw_breakpoint(address, bytes)
    }

    fn remove_hw_breakpoint(&mut self, address: u32, bytes: usize) -> TargetResult<bool, Self> {
        self.remove_sw_breakpoint(address, bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fly::pilot::{Manner, Pilot};
    use crate::rig::tests::{counter, word};
    use crate::{RigConfig, rig};
    use std::io::{Read, Write};

    /// A debugger, and a rig that does what it says.
    struct Bench {
        server: Server,
        attended: Attended,
        debugger: TcpStream,
    }

    impl Bench {
        fn new() -> Self {
            let rig = rig::Rig::new(&counter(), &RigConfig::default()).unwrap();
            let listener = TcpListener::bind("localhost:0").unwrap();
            let debugger = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let server = Server::new(listener).unwrap();
            debugger.set_nodelay(true).unwrap();
            let pilot = Pilot::new([0.0; 2], 0.0, Manner::Steady);
            Self { server, attended: Attended::new(rig, pilot), debugger }
        }

        /// Sends a packet; the answer, while the rig runs on.
        fn ask(&mut self, packet: &str) -> String {
            let sum = packet.bytes().fold(0_u8, u8::wrapping_add);
            self.debugger.write_all(format!("${packet}#{sum:02x}").as_bytes()).unwrap();
            self.debugger.set_nonblocking(true).unwrap();
            let mut answer = String::new();
            for _ in 0..5_000 {
                if !self.server.poll(&mut self.attended).unwrap() {
                    self.attended.run_for(Ticks::from_us(100), &[], &mut |_, _| ()).unwrap();
                }
                let mut bytes = [0; 4_096];
                if let Ok(count) = Read::read(&mut self.debugger, &mut bytes) {
                    answer += std::str::from_utf8(&bytes[..count]).unwrap();
                }
                if let Some((text, sum)) = answer.trim_start_matches('+').split_once('#')
                    && sum.len() == 2
                {
                    self.debugger.write_all(b"+").unwrap();
                    return unpacked(text.trim_start_matches('$'));
                }
            }
            panic!("{packet}: no answer, but {answer:?}");
        }

        fn pc(&mut self) -> u32 {
            let registers = self.ask("g");
            u32::from_str_radix(&registers[120..128], 16).unwrap().swap_bytes()
        }
    }

    /// A character that a star and another one follow stands for more of them: 29 less than that
    /// one's code.
    fn unpacked(text: &str) -> String {
        let mut all: Vec<u8> = Vec::new();
        let mut bytes = text.bytes();
        while let Some(byte) = bytes.next() {
            match byte {
                b'*' => {
                    let more = usize::from(bytes.next().unwrap() - 29);
                    all.extend(std::iter::repeat_n(*all.last().unwrap(), more));
                }
                byte => all.push(byte),
            }
        }
        String::from_utf8(all).unwrap()
    }

    /// The image counts at 0x2000_7800 by its instruction at 0x200e, once a start.
    #[test]
    fn a_debugger_stops_steps_and_goes_back() {
        let mut bench = Bench::new();
        assert!(bench.ask("qSupported:swbreak+").contains("ReverseStep+"));
        assert_eq!(bench.pc(), 0x2008);
        assert_eq!(bench.ask("m2008,2"), "0548", "ldr r0, [pc, #20]");
        assert_eq!(bench.ask("Z1,200e,2"), "OK");
        assert_eq!(&bench.ask("c")[1..3], "05");
        assert_eq!(bench.pc(), 0x200E);
        assert_eq!(word(&bench.attended.rig, 0x7800), {
            let answer = bench.ask("m20007800,4");
            u32::from_str_radix(&answer, 16).unwrap().swap_bytes()
        });
        let counted = word(&bench.attended.rig, 0x7800);
        assert_eq!(&bench.ask("s")[1..3], "05");
        assert_eq!((bench.pc(), word(&bench.attended.rig, 0x7800)), (0x2010, counted + 1));
        assert_eq!(&bench.ask("bs")[1..3], "05");
        assert_eq!((bench.pc(), word(&bench.attended.rig, 0x7800)), (0x200E, counted));
        assert_eq!(&bench.ask("bs")[1..3], "05");
        assert_eq!(bench.pc(), 0x200C);
        for _ in 0..4 {
            bench.ask("s");
        }
        assert_eq!(&bench.ask("bc")[1..3], "05");
        assert_eq!(bench.pc(), 0x200E);
        assert!(bench.ask("bc").contains("replaylog:begin"), "it came here once");
        assert_eq!(bench.ask("M20007800,4:07000000"), "OK");
        assert_eq!(word(&bench.attended.rig, 0x7800), 7);
        assert_eq!(bench.ask("M60000000,1:00"), "E0e");
        assert_eq!(bench.ask("mf0000000,4"), "E0e");
    }

    #[test]
    fn a_debugger_that_leaves_lets_the_rig_run_on() {
        let mut bench = Bench::new();
        bench.ask("Z0,200e,2");
        assert!(bench.server.poll(&mut bench.attended).unwrap());
        bench.debugger.shutdown(std::net::Shutdown::Both).unwrap();
        assert!(!bench.server.poll(&mut bench.attended).unwrap());
        assert!(bench.attended.debug.breakpoints.is_empty());
    }
}
