//! A file's bytes, whatever they are packed by, through a window of bounded size.

use flate2::bufread::MultiGzDecoder;
use std::boxed::Box;
use std::fs::File;
use std::io::{self, BufReader, Cursor, ErrorKind, Read};
use std::path::Path;
use std::vec::Vec;

/// Bytes that begin a gzip member, and a frame of zstd, ordinary or to be skipped.
const GZIP: [u8; 2] = [0x1f, 0x8b];
const ZSTD: [u8; 3] = [0xb5, 0x2f, 0xfd];
const ZSTD_SKIPPED: [u8; 3] = [0x2a, 0x4d, 0x18];
/// The largest window that a zstd frame may ask for is 2 to this, bytes: what `zstd -d` grants unasked.
const ZSTD_WINDOW: u32 = 27;

/// Opens the file at `path` and unpacks it by what it holds, not by what its name says: gzip and zstd, of as many members or frames as there
/// are, or neither.
pub(super) fn open(path: &Path) -> io::Result<Box<dyn Read + Send>> {
    unpack(File::open(path)?)
}

/// Unpacks `input` by what it holds.
pub(super) fn unpack(mut input: impl Read + Send + 'static) -> io::Result<Box<dyn Read + Send>> {
    let mut magic = Vec::new();
    (&mut input).take(4).read_to_end(&mut magic)?;
    let (is_gzip, is_zstd) = (
        magic.starts_with(&GZIP),
        magic.get(1..4).is_some_and(|rest| (magic[0] == 0x28 && rest == ZSTD) || (magic[0] >> 4 == 5 && rest == ZSTD_SKIPPED)),
    );
    let whole = Cursor::new(magic).chain(input);
    if is_gzip {
        return Ok(Box::new(MultiGzDecoder::new(BufReader::with_capacity(1 << 16, whole))));
    }
    if is_zstd {
        let mut decoder = zstd::Decoder::new(whole)?;
        decoder.window_log_max(ZSTD_WINDOW)?;
        return Ok(Box::new(decoder));
    }
    Ok(Box::new(whole))
}

/// How much is asked for at once, bytes.
const CHUNK: usize = 1 << 18;

/// The bytes ahead in a stream; what was passed is forgotten.
pub(super) struct Window<R> {
    input: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    passed: u64,
}

impl<R: Read> Window<R> {
    pub(super) fn new(input: R) -> Self {
        Self { input, buffer: std::vec![0; CHUNK], start: 0, end: 0, passed: 0 }
    }

    /// Bytes that were passed.
    pub(super) fn passed(&self) -> u64 {
        self.passed
    }

    /// Makes sure of `count` bytes ahead; how many there are, which is fewer only at the end.
    pub(super) fn fill(&mut self, count: usize) -> io::Result<usize> {
        if self.end - self.start >= count {
            return Ok(self.end - self.start);
        }
        self.buffer.copy_within(self.start..self.end, 0);
        (self.start, self.end) = (0, self.end - self.start);
        if self.buffer.len() < count {
            self.buffer.resize(count, 0);
        }
        while self.end < count {
            match self.input.read(&mut self.buffer[self.end..]) {
                Ok(0) => break,
                Ok(read) => self.end += read,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(self.end)
    }

    /// What is ahead, as far as it was filled.
    pub(super) fn ahead(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Passes `count` bytes of what is ahead.
    pub(super) fn pass(&mut self, count: usize) {
        self.start = (self.start + count).min(self.end);
        self.passed += count as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn unpacked(bytes: &[u8]) -> io::Result<Vec<u8>> {
        let mut all = Vec::new();
        unpack(Cursor::new(bytes.to_vec())).and_then(|mut input| input.read_to_end(&mut all)).map(|_| all)
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn content_says_how_it_is_packed() {
        let zstd = |bytes: &[u8]| zstd::encode_all(bytes, 1).unwrap();
        for bytes in [&b""[..], b"a", b"abc", b"plain text"] {
            assert_eq!(unpacked(bytes).unwrap(), bytes);
            assert_eq!(unpacked(&[gzip(bytes), gzip(b"and more")].concat()).unwrap(), [bytes, b"and more"].concat());
            assert_eq!(unpacked(&[zstd(bytes), zstd(b"and more")].concat()).unwrap(), [bytes, b"and more"].concat());
        }
        let skipped = [&[0x5f, 0x2a, 0x4d, 0x18, 2, 0, 0, 0, 9, 9][..], &zstd(b"a")].concat();
        assert_eq!(unpacked(&skipped).unwrap(), b"a");
    }

    #[test]
    fn what_comes_before_a_cut_is_read() {
        let bytes: Vec<u8> = (0..400_000_u32).flat_map(|i| (i * 7919).to_le_bytes()).collect();
        for packed in [gzip(&bytes), zstd::encode_all(&bytes[..], 1).unwrap()] {
            let mut input = unpack(Cursor::new(packed[..packed.len() * 3 / 4].to_vec())).unwrap();
            let mut read = Vec::new();
            assert_eq!(input.read_to_end(&mut read).unwrap_err().kind(), ErrorKind::UnexpectedEof);
            assert!(read.len() > bytes.len() / 2 && bytes.starts_with(&read));
        }
    }

    #[test]
    fn a_window_moves_on() {
        let bytes: Vec<u8> = (0..3 * CHUNK).map(|i| (i % 251) as u8).collect();
        let mut window = Window::new(&bytes[..]);
        let mut seen = Vec::new();
        while window.fill(1000).unwrap() >= 1000 {
            seen.extend_from_slice(&window.ahead()[..777]);
            window.pass(777);
        }
        seen.extend_from_slice(window.ahead());
        assert_eq!(seen, bytes);
        assert_eq!(Window::new(&bytes[..]).fill(2 * CHUNK).unwrap(), 2 * CHUNK);
    }
}
