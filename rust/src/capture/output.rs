//! A file that is packed, or not, as its name says.

use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The first of `paths` at which there is something, which is not to be overwritten; an empty file is nothing.
pub fn occupied(paths: impl IntoIterator<Item = PathBuf>) -> Option<PathBuf> {
    paths.into_iter().find(|path| std::fs::metadata(path).is_ok_and(|found| !(found.is_file() && found.len() == 0)))
}

/// A file to be written through. What was flushed can be read back, even if the end is never written.
pub enum Output {
    /// As it is.
    Plain(BufWriter<File>),
    /// By gzip.
    Gzip(GzEncoder<BufWriter<File>>),
    /// By zstd.
    Zstd(zstd::Encoder<'static, BufWriter<File>>),
}

impl Output {
    /// The new file `path`, packed if its name ends with `.gz` or `.zst`, as thoroughly as `level` says (gzip 0 to 9, zstd 1 to 22), or at
    /// the speed of a Kinect.
    ///
    /// # Errors
    /// Whatever the operating system refuses.
    pub fn create(path: &Path, level: Option<u8>) -> io::Result<Self> {
        let file = BufWriter::with_capacity(1 << 16, File::create(path)?);
        let extension = path.extension().map(std::ffi::OsStr::to_ascii_lowercase);
        match extension.as_ref().and_then(|extension| extension.to_str()) {
            Some("gz") => {
                Ok(Self::Gzip(GzEncoder::new(file, level.map_or(Compression::fast(), |level| Compression::new(level.min(9).into())))))
            }
            Some("zst") => {
                let mut encoder = zstd::Encoder::new(file, level.map_or(1, i32::from))?;
                encoder.include_checksum(true)?;
                Ok(Self::Zstd(encoder))
            }
            _ => Ok(Self::Plain(file)),
        }
    }

    /// Completes the file.
    ///
    /// # Errors
    /// Whatever the operating system refuses.
    pub fn finish(self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file,
            Self::Gzip(encoder) => encoder.finish()?,
            Self::Zstd(encoder) => encoder.finish()?,
        }
        .flush()
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(file) => file.write(bytes),
            Self::Gzip(encoder) => encoder.write(bytes),
            Self::Zstd(encoder) => encoder.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(file) => file.flush(),
            Self::Gzip(encoder) => encoder.flush(),
            Self::Zstd(encoder) => encoder.flush(),
        }
    }
}
