//! Whatever is sent to the program, it goes on, its memory stays bounded, and STOP is heard.

use std::fs::read_to_string;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::page::{Page, Server, vehicle};

/// What an idle machine keeps.
const QUICK: Duration = Duration::from_millis(100);
/// A generous bound for a busy machine; some ms are usual.
const STOP: Duration = Duration::from_secs(1);
/// The rest of a head that opens a WebSocket.
const UPGRADE: &str = "Upgrade: websocket\r\nConnection: upgrade\r\nSec-WebSocket-Version: 13\r\n\
    Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
/// Connections that are kept open.
const KEPT: usize = 300;

/// What is in the memory of the program, KiB.
fn resident_kib(server: &Server) -> u64 {
    let status = read_to_string(format!("/proc/{}/status", server.web.0.id())).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// A hostile request, one of several kinds.
fn bytes(kind: usize, host: &str) -> Vec<u8> {
    let mut random = (kind as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut noise = |count: usize| -> Vec<u8> {
        let mut next = || {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random as u8
        };
        (0..count).map(|_| next()).collect()
    };
    let head = |method: &str, path: &str, rest: &str| {
        format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\n{rest}")
    };
    let text = match kind % 10 {
        0 => head("POST", "/x", "Host: evil\r\nContent-Length: 99999999999\r\n\r\n"),
        1 => head("POST", "/stop", "Content-Length: 99999999999\r\n\r\nx"),
        2 => head("POST", "/arm", "Content-Length: 1000\r\n\r\nhalf"),
        3 => head("GET", "/", "X: "),
        4 => head("GET", "/", &"A: b\r\n".repeat(5_000)),
        5 => head("GET", &"/a".repeat(50_000), ""),
        6 => {
            let chunked = "Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n";
            head("POST", "/", chunked)
        }
        7 => {
            let socket = head("GET", "/page", UPGRADE);
            // A frame of 2^63 bytes, then noise.
            let frame = [0x81, 0xFF, 0x7F, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF];
            return [socket.as_bytes(), &frame, &noise(100)].concat();
        }
        8 => return noise(500),
        _ => String::new(),
    };
    text.into_bytes()
}

/// Sends `count` requests, of which some connections stay open; how long each STOP among them took,
/// and the growth of the memory, KiB.
fn attack(server: &Server, page: &Page, count: usize) -> (Vec<Duration>, u64) {
    let mut kept = Vec::new();
    let (mut stops, mut before, mut most) = (Vec::new(), None, 0);
    for number in 0..count {
        let Ok(mut stream) = TcpStream::connect(&server.address) else {
            panic!("{number}: the program is gone");
        };
        // The program may have closed it meanwhile.
        let _ = stream.write_all(&bytes(number, &server.address));
        match number % 3 {
            0 if kept.len() < KEPT => kept.push(stream),
            0 => kept[number / 3 % KEPT] = stream,
            1 => {
                let _ = stream.set_read_timeout(Some(Duration::from_millis(1)));
                let _ = stream.read(&mut [0; 64]);
            }
            _ => {}
        }
        if number % 500 == 499 {
            let begun = Instant::now();
            page.press("stop");
            stops.push(begun.elapsed());
            let now = resident_kib(server);
            // What the first requests need stays.
            before = before.or(Some(now));
            most = most.max(now);
        }
    }
    (stops, most - before.unwrap_or(most))
}

/// Two requests that once ended the program or kept STOP out, and many connections that wait.
#[test]
fn no_request_ends_the_program_or_keeps_stop_out() {
    let (folder, port, _rig) = vehicle();
    // Fewer descriptors than connections are tried.
    let server = Server::limited(&port, folder.path(), "ulimit -n 60");
    let page = server.page();
    page.arm();
    let huge = "Content-Length: 99999999999\r\n";
    assert_eq!(server.ask("POST /x", &format!("Host: evil\r\n{huge}")).0, 403);
    let begin = |text: &str| {
        let mut stream = TcpStream::connect(&server.address).unwrap();
        // It may have been closed at once.
        let _ = stream.write_all(text.as_bytes());
        stream
    };
    let half =
        format!("POST /stop HTTP/1.1\r\nHost: {}\r\nContent-Length: 9\r\n\r\n1", server.address);
    let _halves: Vec<_> = (0..300).map(|_| begin(&half)).collect();
    let _idle: Vec<_> = (0..500).map(|_| begin("")).collect();
    page.wait_for("armed");
    let begun = Instant::now();
    page.press("stop");
    assert!(begun.elapsed() < STOP, "{:?}", begun.elapsed());
    page.wait_for("standby");
    // A new page is let in, and a STOP by HTTP.
    server.page().wait_for("standby");
    let begun = Instant::now();
    assert_eq!(server.ask("POST /stop", "X-Stop: 1\r\n").0, 200);
    assert!(begun.elapsed() < STOP, "{:?}", begun.elapsed());
}

#[test]
fn many_hostile_requests_leave_memory_and_stop_as_they_were() {
    attack_a_server(3_000);
}

/// `HOSTILE=1000000 cargo test -p ground --test real_time -- --ignored --nocapture hostile`
#[test]
#[ignore = "takes minutes: for whoever changes the server"]
fn a_long_run_of_hostile_requests() {
    let count = std::env::var("HOSTILE").map_or(100_000, |count| count.parse().unwrap());
    attack_a_server(count);
}

/// STOP stays quick, memory bounded and the page connected under this many requests.
fn attack_a_server(count: usize) {
    let (folder, port, _rig) = vehicle();
    let server = Server::of(&port, folder.path());
    let page = server.page();
    page.wait_for("standby");
    let begun = Instant::now();
    let (stops, growth_kib) = attack(&server, &page, count);
    let longest = stops.iter().max().copied().unwrap_or_default();
    let slow = stops.iter().filter(|took| **took > QUICK).count();
    println!(
        "{count} requests in {:.0} s: {slow} of {} STOPs took more than {QUICK:?}, {:.1} ms at most, \
         memory +{growth_kib} KiB",
        begun.elapsed().as_secs_f64(),
        stops.len(),
        longest.as_secs_f64() * 1e3
    );
    assert!(longest < STOP, "{longest:?}");
    assert!(growth_kib < 20_000, "{growth_kib} KiB");
    assert_eq!(page.wait("condition", |_| true)["connected"], Value::Bool(true));
}
