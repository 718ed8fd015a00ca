use super::*;
use crate::memory::Memory;

const BASE: u32 = 0x2000_0100;

fn ready() -> (Usb, Memory) {
    let mut usb = Usb::new(Ticks::ZERO);
    usb.set_clock(Ticks::ZERO, Some(Rate::from_hz(48_000_000)));
    usb.pads = true;
    usb.ctrla = ENABLE;
    usb.ctrlb = 0;
    usb.descriptors = BASE;
    let mut memory = Memory::new(0);
    for number in 0..8 {
        for bank in 0..2 {
            let at = BASE + 32 * number + 16 * bank;
            let buffer = 0x2000_1000 + 0x400 * number + 0x200 * bank;
            memory.write_u32(at, buffer).unwrap();
            memory.write_u32(at + 4, 3 << 28).unwrap();
        }
    }
    (usb, memory)
}

fn config(usb: &mut Usb, number: u32, config: u32) {
    usb.endpoints[number as usize].write(0, Lanes::new(config, 0, 1)).unwrap();
}

fn status(usb: &Usb, number: usize) -> u8 {
    (usb.endpoints[number].read(4).unwrap() >> 16) as u8
}

fn flags(usb: &Usb, number: usize) -> u8 {
    (usb.endpoints[number].read(4).unwrap() >> 24) as u8
}

fn put(usb: &mut Usb, number: u32, byte: u32, value: u32) {
    usb.endpoints[number as usize].write(4, Lanes::new(value, byte, 1)).unwrap();
}

#[test]
fn a_setup_sets_and_clears_what_the_data_sheet_says() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 0, 0x11);
    put(&mut usb, 0, 1, 0xB0);
    let bytes = [0x80, 6, 0, 1, 0, 0, 8, 0];
    assert_eq!(usb.setup(0, 0, bytes, &mut memory), Ok(()));
    assert_eq!(memory.bytes(0x2000_1000, 8), Some(&bytes[..]));
    assert_eq!(memory.read_u32(BASE + 4), Some(3 << 28 | 8));
    // BK0RDY, CURBK, DTGLIN, DTGLOUT; BK1RDY and STALLRQ gone.
    assert_eq!(status(&usb, 0), 0x47);
    assert_eq!(flags(&usb, 0), 0x10);
    // The data stage finds the bank taken, a second SETUP finds RXSTP set.
    assert_eq!(usb.output(0, 0, true, &[1], &mut memory), Err(Refused::Nak));
    assert_eq!(usb.setup(0, 0, bytes, &mut memory), Err(Refused::Silence));
}

#[test]
fn the_device_answers_to_its_address_only() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 0, 0x11);
    usb.address = 5;
    assert_eq!(usb.setup(5, 0, [0; 8], &mut memory), Err(Refused::Silence));
    usb.address = 0x85;
    assert_eq!(usb.setup(0, 0, [0; 8], &mut memory), Err(Refused::Silence));
    assert_eq!(usb.setup(5, 0, [0; 8], &mut memory), Ok(()));
    assert_eq!(usb.output(5, 3, false, &[], &mut memory), Err(Refused::Silence));
    // A descriptor may name an endpoint that the chip does not have.
    assert_eq!(usb.output(5, 9, false, &[], &mut memory), Err(Refused::Silence));
    assert!(!usb.would_nak(9, false));
}

#[test]
fn out_toggles_and_a_repeated_packet_is_dropped() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 2, 0x33);
    assert_eq!(usb.output(0, 2, false, b"abc", &mut memory), Ok(()));
    assert_eq!(status(&usb, 2), 0x41);
    assert_eq!(flags(&usb, 2), 0x01);
    assert_eq!(usb.output(0, 2, true, b"xyz", &mut memory), Err(Refused::Nak));
    assert_eq!(flags(&usb, 2), 0x05);
    put(&mut usb, 2, 0, 0x40);
    put(&mut usb, 2, 3, 0x05);
    assert_eq!(usb.output(0, 2, false, b"abc", &mut memory), Ok(()));
    assert_eq!((status(&usb, 2), flags(&usb, 2)), (0x01, 0), "dropped");
    assert_eq!(usb.output(0, 2, true, b"xyz", &mut memory), Ok(()));
    assert_eq!(memory.bytes(0x2000_1800, 3), Some(&b"xyz"[..]));
}

#[test]
fn out_gathers_packets_up_to_the_multi_packet_size() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 2, 0x33);
    let pcksize = BASE + 2 * 32 + 4;
    memory.write_u32(pcksize, 3 << 28 | 128 << 14).unwrap();
    assert_eq!(usb.output(0, 2, false, &[1; 64], &mut memory), Ok(()));
    assert_eq!(status(&usb, 2) & 0x40, 0);
    assert_eq!(usb.output(0, 2, true, &[2; 64], &mut memory), Ok(()));
    assert_eq!(status(&usb, 2) & 0x40, 0x40);
    assert_eq!(memory.read_u32(pcksize).unwrap() & 0x3FFF, 128);
    assert_eq!(memory.bytes(0x2000_1800 + 64, 1), Some(&[2][..]));
}

#[test]
fn in_sends_a_long_transfer_in_packets_with_a_zero_packet_if_asked() {
    for zero_packet in [false, true] {
        let (mut usb, mut memory) = ready();
        config(&mut usb, 2, 0x33);
        let pcksize = 3 << 28 | 128 | u32::from(zero_packet) << 31;
        memory.write_u32(BASE + 2 * 32 + 20, pcksize).unwrap();
        let source = memory.ram_bytes_mut(0x2000_1A00, 128).unwrap();
        source.iter_mut().zip(0..).for_each(|(byte, n)| *byte = n);
        assert_eq!(usb.input(0, 2, true, &mut memory), Err(Refused::Nak));
        assert_eq!(flags(&usb, 2), 0x08);
        put(&mut usb, 2, 1, 0x80);
        let packet = |from: u8, toggle| Ok(((from..from + 64).collect(), toggle));
        assert_eq!(usb.input(0, 2, true, &mut memory), packet(0, false));
        assert_eq!(status(&usb, 2) & 0x80, 0x80);
        assert_eq!(usb.input(0, 2, true, &mut memory), packet(64, true));
        if zero_packet {
            assert_eq!(usb.input(0, 2, true, &mut memory), Ok((vec![], false)));
        }
        assert_eq!(status(&usb, 2) & 0x80, 0);
        assert_eq!(flags(&usb, 2) & 0x02, 0x02);
    }
}

#[test]
fn a_driver_that_writes_byte_count_alone_sends_one_packet_after_the_other() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 2, 0x33);
    let pcksize = BASE + 2 * 32 + 20;
    memory.ram_bytes_mut(0x2000_1A00, 3).unwrap().copy_from_slice(b"abc");
    for (count, toggle) in [(3, false), (1, true), (3, false)] {
        let others = memory.read_u32(pcksize).unwrap() & !0x3FFF;
        memory.write_u32(pcksize, others | count).unwrap();
        put(&mut usb, 2, 1, 0x80);
        let sent = b"abc"[..count as usize].to_vec();
        assert_eq!(usb.input(0, 2, true, &mut memory), Ok((sent, toggle)));
        assert_eq!(status(&usb, 2) & 0x80, 0);
    }
}

#[test]
fn stall_answers_both_ways_until_a_setup() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 0, 0x11);
    put(&mut usb, 0, 1, 0x30);
    assert_eq!(usb.input(0, 0, true, &mut memory), Err(Refused::Stall));
    assert_eq!(usb.output(0, 0, true, &[], &mut memory), Err(Refused::Stall));
    assert_eq!(flags(&usb, 0), 0x60);
    assert_eq!(usb.setup(0, 0, [0; 8], &mut memory), Ok(()));
    assert_eq!(usb.input(0, 0, true, &mut memory), Err(Refused::Nak));
}

#[test]
fn a_bus_reset_clears_all_but_the_ready_bits_and_endpoint_zero() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 0, 0x11);
    config(&mut usb, 2, 0x33);
    usb.endpoints[2].write(8, Lanes::new(0x03, 1, 1)).unwrap();
    assert_eq!(usb.output(0, 2, false, b"abc", &mut memory), Ok(()));
    assert_eq!(usb.summary(), 1 << 2);
    usb.address = 0x85;
    usb.bus_reset(Ticks::from_ms(1));
    assert_eq!(usb.endpoints[0].read(0), Ok(0x11));
    assert_eq!(usb.endpoints[2].read(0), Ok(0));
    assert_eq!(status(&usb, 2), 0x40, "BK0RDY stays, the toggle goes");
    assert_eq!((usb.summary(), usb.address), (0, 0));
    assert_eq!(usb.interrupts.flags, EORST);
    usb.endpoints[2].write(8, Lanes::new(0x03, 1, 1)).unwrap();
    assert_eq!(usb.endpoints[2].read(8), Ok(0), "no type, no interrupts");
}

#[test]
fn descriptors_outside_of_sram_are_an_access_error() {
    let (mut usb, mut memory) = ready();
    config(&mut usb, 0, 0x11);
    usb.descriptors = 0x3000_0000;
    assert_eq!(usb.setup(0, 0, [0; 8], &mut memory), Err(Refused::Silence));
    assert_eq!(usb.interrupts.flags, RAMACER);
}

#[test]
fn an_idle_bus_suspends_and_a_frame_wakes() {
    let (mut usb, _) = ready();
    usb.start_of_frame(Ticks::from_ms(1), 77);
    assert_eq!(usb.next(), Ticks::from_ms(4));
    usb.advance(Ticks::from_ms(4));
    assert_eq!(usb.interrupts.flags, SUSPEND | SOF);
    assert_eq!(usb.next(), Ticks::NEVER);
    usb.start_of_frame(Ticks::from_ms(5), 78);
    assert_eq!(usb.interrupts.flags, SUSPEND | SOF | WAKEUP);
    assert_eq!(usb.read(Ticks::ZERO, 0x10), Ok(78 << 3));
}
