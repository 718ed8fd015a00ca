//! MAVLink FTP, for reading a few files that are in memory.
//!
//! There is no state: a session is the number of the file that was opened. A request is a number, a
//! session, an operation, a size, an offset and data; its answer has the next number. A burst is
//! several answers with numbers in a row, as if each part had been asked for.

/// Bytes of a request or an answer.
pub const PAYLOAD: usize = 251;
const HEADER: usize = 12;
/// Most bytes of a file in one answer.
const DATA: usize = PAYLOAD - HEADER;
/// Most answers to one request.
const BURST: usize = 16;

const TERMINATE_SESSION: u8 = 1;
const RESET_SESSIONS: u8 = 2;
const OPEN_TO_READ: u8 = 4;
const READ: u8 = 5;
const CHECKSUM: u8 = 14;
const BURST_READ: u8 = 15;
const ACCEPTED: u8 = 128;
const REFUSED: u8 = 129;

const INVALID_SESSION: u8 = 4;
const END_OF_FILE: u8 = 6;
const UNKNOWN_OPERATION: u8 = 7;
const NO_SUCH_FILE: u8 = 10;

/// A file.
#[derive(Clone, Debug)]
pub struct File {
    /// Its path, which begins with a slash.
    pub path: &'static str,
    /// What is in it.
    pub content: Vec<u8>,
}

impl File {
    /// The checksum that the protocol has for files: CRC-32 without its two inversions.
    pub fn checksum(&self) -> u32 {
        const PLAIN: crc::Algorithm<u32> = crc::Algorithm {
            init: 0,
            xorout: 0,
            check: 0x2DFD_2D88,
            residue: 0,
            ..crc::CRC_32_ISO_HDLC
        };
        crc::Crc::<u32>::new(&PLAIN).checksum(&self.content)
    }
}

/// What a request asks for.
struct Request<'a> {
    number: u16,
    session: u8,
    operation: u8,
    size: usize,
    offset: usize,
    data: &'a [u8],
}

impl<'a> Request<'a> {
    fn parse(payload: &'a [u8; PAYLOAD]) -> Self {
        let [
            n0,
            n1,
            session,
            operation,
            size,
            _,
            _,
            _,
            o0,
            o1,
            o2,
            o3,
            data @ ..,
        ] = payload;
        let size = usize::from(*size).min(DATA);
        Self {
            number: u16::from_le_bytes([*n0, *n1]),
            session: *session,
            operation: *operation,
            size,
            offset: u32::from_le_bytes([*o0, *o1, *o2, *o3]) as usize,
            data: &data[..size],
        }
    }

    /// The answer that is `index` behind the first.
    fn answer(
        &self,
        index: usize,
        kind: u8,
        offset: usize,
        data: &[u8],
        last: bool,
    ) -> [u8; PAYLOAD] {
        let mut payload = [0; PAYLOAD];
        let number = self.number.wrapping_add(1 + index as u16);
        payload[..2].copy_from_slice(&number.to_le_bytes());
        let last = u8::from(last && self.operation == BURST_READ);
        payload[2..7].copy_from_slice(&[
            self.session,
            kind,
            data.len() as u8,
            self.operation,
            last,
        ]);
        payload[8..HEADER].copy_from_slice(&(offset as u32).to_le_bytes());
        payload[HEADER..HEADER + data.len()].copy_from_slice(data);
        payload
    }

    fn accepted(&self, data: &[u8]) -> Vec<[u8; PAYLOAD]> {
        vec![self.answer(0, ACCEPTED, self.offset, data, true)]
    }

    fn refused(&self, why: u8) -> Vec<[u8; PAYLOAD]> {
        vec![self.answer(0, REFUSED, self.offset, &[why], true)]
    }

    /// As many parts of a file as `most`.
    fn read(&self, file: &File, most: usize) -> Vec<[u8; PAYLOAD]> {
        let size = if self.size == 0 { DATA } else { self.size };
        let rest = file.content.get(self.offset..).unwrap_or_default();
        let parts: Vec<_> = rest.chunks(size).take(most).collect();
        if parts.is_empty() {
            return self.refused(END_OF_FILE);
        }
        let answer = |(index, part): (usize, &&[u8])| {
            let offset = self.offset + index * size;
            self.answer(index, ACCEPTED, offset, part, index + 1 == parts.len())
        };
        parts.iter().enumerate().map(answer).collect()
    }
}

/// The answers to a request.
pub fn answers(files: &[File], payload: &[u8; PAYLOAD]) -> Vec<[u8; PAYLOAD]> {
    let mut request = Request::parse(payload);
    let opened = files.get(usize::from(request.session));
    // Paths come with and without a slash before them, and with and without a zero behind them.
    let path = request
        .data
        .split(|byte| *byte == 0)
        .next()
        .unwrap_or_default();
    let named = files.iter().position(|file| {
        let bare = file.path.trim_start_matches('/').as_bytes();
        path == file.path.as_bytes() || path == bare
    });
    match (request.operation, named, opened) {
        (TERMINATE_SESSION | RESET_SESSIONS, ..) => request.accepted(&[]),
        (OPEN_TO_READ, Some(index), _) => {
            request.session = index as u8;
            request.accepted(&(files[index].content.len() as u32).to_le_bytes())
        }
        (CHECKSUM, Some(index), _) => request.accepted(&files[index].checksum().to_le_bytes()),
        (OPEN_TO_READ | CHECKSUM, None, _) => request.refused(NO_SUCH_FILE),
        (READ, _, Some(file)) => request.read(file, 1),
        (BURST_READ, _, Some(file)) => request.read(file, BURST),
        (READ | BURST_READ, _, None) => request.refused(INVALID_SESSION),
        _ => request.refused(UNKNOWN_OPERATION),
    }
}
