//! Positions by any tracker, as CSV.

use super::decimal::nanoseconds;
use super::order::Order;
use super::{Input, MOST_POSITIONS, Source, SourceError, measurement};
use crate::geometry::camera::Camera;
use crate::math::{Mat3, Vec3};
use crate::track::Measurement;
use ::csv::{Reader, ReaderBuilder, StringRecord, Trim};
use std::format;
use std::fs::File;
use std::io::{self, Read};
use std::string::{String, ToString};
use std::vec::{self, Vec};

/// Reads `t,x,y,z` (s, m, world frame), in any order, with optional `track` and `xx,xy,xz,yy,yz,zz` (m²). Other columns are ignored. Rows of
/// equal `t` are one instant; an empty or NaN coordinate says that the object wasn't seen then. Of a pipe, which is read line by line, an
/// instant is handed out as soon as the line after it arrives.
pub struct Csv<R> {
    name: String,
    reader: Reader<Lines<R>>,
    radius: f64,
    columns: Option<Columns>,
    record: StringRecord,
    /// All rows that are still to come, where those of the file had to be sorted.
    sorted: Option<vec::IntoIter<Row>>,
    order: Order,
    /// The first row of the next instant, already read.
    ahead: Option<Row>,
    positions: Vec<Measurement>,
}

struct Columns {
    count: usize,
    t: usize,
    center: [usize; 3],
    track: Option<usize>,
    /// `xx xy xz yy yz zz`
    covariance: Option<[usize; 6]>,
}

struct Row {
    line: u64,
    timestamp_ns: i64,
    measurement: Option<Measurement>,
}

impl<R: Read> Csv<R> {
    /// Positions of balls of `radius` (m) in `input`. The header is read with the first input: opening a silent pipe doesn't wait.
    pub fn new(name: &str, input: R, radius: f64) -> Self {
        let reader = ReaderBuilder::new().has_headers(false).flexible(true).trim(Trim::All).from_reader(Lines { input, length: 0 });
        Self {
            name: name.into(),
            reader,
            radius,
            columns: None,
            record: StringRecord::new(),
            sorted: None,
            order: Order::default(),
            ahead: None,
            positions: Vec::new(),
        }
    }

    /// Reads the next line into `record`; `false` at the end.
    fn read_record(&mut self) -> Result<bool, SourceError> {
        self.reader.read_record(&mut self.record).map_err(|error| SourceError::malformed(&self.name, explain(&error)))
    }

    fn next_row(&mut self) -> Result<Option<Row>, SourceError> {
        if self.columns.is_none() {
            if !self.read_record()? {
                return Ok(None);
            }
            self.columns = Some(Columns::find(&self.record).map_err(|what| SourceError::malformed(&self.name, what))?);
        }
        if !self.read_record()? {
            return Ok(None);
        }
        let Some(columns) = &self.columns else { return Ok(None) };
        let line = self.record.position().map_or(0, ::csv::Position::line);
        columns.row(line, &self.record, self.radius).map(Some).map_err(|what| self.malformed(line, &what))
    }

    /// The next row in the order in which they are handed out.
    fn following(&mut self) -> Result<Option<Row>, SourceError> {
        match &mut self.sorted {
            Some(sorted) => Ok(sorted.next()),
            None => self.next_row(),
        }
    }

    /// Whether its rows, as far as they can be read, are in the order of time.
    fn rises(mut self) -> bool {
        let mut newest = i64::MIN;
        while let Ok(Some(row)) = self.next_row() {
            if row.timestamp_ns < newest {
                return false;
            }
            newest = row.timestamp_ns;
        }
        true
    }

    fn malformed(&self, line: u64, what: &str) -> SourceError {
        SourceError::malformed(&self.name, format!("line {line}: {what}"))
    }
}

impl Csv<File> {
    /// Positions of balls of `radius` (m) in the file `name`, in the order of time, whatever that of its rows is: one that is not sorted, as
    /// where one track follows the other, is kept in memory.
    ///
    /// # Errors
    /// It can't be opened; or it is not sorted, and a row is not as it should be.
    pub fn open(name: &str, radius: f64) -> Result<Self, SourceError> {
        let open = || File::open(name).map_err(|error| SourceError::unreadable(name, error));
        let file = open()?;
        let is_pipe = !file.metadata().is_ok_and(|kind| kind.is_file());
        let mut csv = Self::new(name, file, radius);
        if is_pipe || Self::new(name, open()?, radius).rises() {
            return Ok(csv);
        }
        let mut rows = Vec::new();
        while let Some(row) = csv.next_row()? {
            rows.push(row);
        }
        rows.sort_by_key(|row| row.timestamp_ns);
        csv.sorted = Some(rows.into_iter());
        Ok(csv)
    }
}

impl<R: Read + Send> Source for Csv<R> {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        None
    }

    fn remarks(&self) -> Vec<String> {
        self.order.remark().into_iter().collect()
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        let Some(first) = self.ahead.take().map_or_else(|| self.following(), |row| Ok(Some(row)))? else { return Ok(None) };
        let timestamp_ns = first.timestamp_ns;
        self.order.see(timestamp_ns, first.line);
        self.positions.clear();
        self.positions.extend(first.measurement);
        loop {
            match self.following()? {
                Some(row) if row.timestamp_ns == timestamp_ns => {
                    self.positions.extend(row.measurement);
                    if self.positions.len() > MOST_POSITIONS {
                        let what = format!("more than {MOST_POSITIONS} positions at one time: does `t` stand still?");
                        return Err(self.malformed(row.line, &what));
                    }
                }
                ahead => {
                    self.ahead = ahead;
                    return Ok(Some(Input::Positions { timestamp_ns, positions: &self.positions }));
                }
            }
        }
    }
}

impl Columns {
    fn find(header: &StringRecord) -> Result<Self, String> {
        let names: Vec<_> = header.iter().map(|field| field.trim_start_matches('\u{feff}').trim_matches('"')).collect();
        let column = |name: &str| names.iter().position(|field| *field == name);
        let covariance = ["xx", "xy", "xz", "yy", "yz", "zz"];
        let is_twice = |name: &&str| names.iter().filter(|field| *field == name).count() > 1;
        if let Some(twice) = ["t", "x", "y", "z", "track"].into_iter().chain(covariance).find(is_twice) {
            return Err(format!("line 1: two columns are called `{twice}`"));
        }
        let needed = |name: &str| {
            column(name).ok_or_else(|| {
                let shown: String = header.iter().collect::<Vec<_>>().join(",").chars().take(60).collect();
                let fix = if let Some(wrong) = header.iter().flat_map(str::chars).find(|c| [';', '\t'].contains(c)) {
                    format!("; separate columns by `,` instead of {wrong:?}")
                } else if let Some(wrong) = header.iter().find(|field| field.eq_ignore_ascii_case(name)) {
                    format!("; write `{name}` instead of `{wrong}`")
                } else {
                    String::new()
                };
                format!("line 1: no column `{name}`; the header must be t,x,y,z (s and m), it is {shown:?}{fix}")
            })
        };
        Ok(Self {
            count: names.len(),
            t: needed("t")?,
            center: [needed("x")?, needed("y")?, needed("z")?],
            track: column("track"),
            covariance: if covariance.iter().any(|name| column(name).is_some()) {
                let mut found = [0; 6];
                for (index, name) in found.iter_mut().zip(covariance) {
                    *index = needed(name)?;
                }
                Some(found)
            } else {
                None
            },
        })
    }

    fn row(&self, line: u64, record: &StringRecord, radius: f64) -> Result<Row, String> {
        if record.len() > self.count {
            return Err(format!("{} fields, the header has {}", record.len(), self.count));
        }
        let t = field(record, self.t)?;
        let timestamp_ns = nanoseconds(t).ok_or_else(|| format!("t = {t:?} is no decimal number of seconds"))?;
        let [Some(x), Some(y), Some(z)] = numbers(record, self.center)? else { return Ok(Row { line, timestamp_ns, measurement: None }) };
        let label = match self.track.map(|column| field(record, column)).transpose()? {
            None | Some("") => None,
            Some(text) => Some(text.parse().map_err(|_| format!("track = {text:?} is no integer from 0 on"))?),
        };
        let covariance = match self.covariance.map(|columns| numbers(record, columns)).transpose()? {
            Some([Some(xx), Some(xy), Some(xz), Some(yy), Some(yz), Some(zz)]) => Some(Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)),
            _ => None,
        };
        let measurement = measurement(timestamp_ns, Vec3::new(x, y, z), covariance, label, radius)?;
        Ok(Row { line, timestamp_ns, measurement: Some(measurement) })
    }
}

fn field(record: &StringRecord, column: usize) -> Result<&str, String> {
    record.get(column).ok_or_else(|| format!("{} fields, the header has more", record.len()))
}

/// The numbers in `columns`; `None` where a field is empty or NaN.
fn numbers<const N: usize>(record: &StringRecord, columns: [usize; N]) -> Result<[Option<f64>; N], String> {
    let mut numbers = [None; N];
    for (number, column) in numbers.iter_mut().zip(columns) {
        let text = field(record, column)?;
        if !text.is_empty() {
            let x: f64 = text.parse().map_err(|_| format!("{text:?} is no number"))?;
            *number = (!x.is_nan()).then_some(x);
        }
    }
    Ok(numbers)
}

fn explain(error: &::csv::Error) -> String {
    match error.kind() {
        ::csv::ErrorKind::Io(error) => error.to_string(),
        ::csv::ErrorKind::Utf8 { pos, .. } => {
            format!("line {}: not text; a CSV with the header t,x,y,z is expected", pos.as_ref().map_or(0, ::csv::Position::line))
        }
        _ => error.to_string(),
    }
}

/// The longest line that is read; a longer one is no CSV of positions, and isn't kept in memory.
const LONGEST_LINE: usize = 1 << 16;

/// Passes bytes through, and breaks off at a line that doesn't end.
struct Lines<R> {
    input: R,
    length: usize,
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.input.read(buffer)?;
        self.length = match buffer[..count].iter().rposition(|&byte| byte == b'\n') {
            Some(end) => count - end - 1,
            None => self.length + count,
        };
        if self.length > LONGEST_LINE {
            return Err(io::Error::other("a line of more than 64 KiB; a CSV with the header t,x,y,z is expected"));
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::borrow::ToOwned;

    /// Each instant's stamp and how many positions it has; or what is wrong.
    fn instants(text: impl AsRef<[u8]>) -> Result<Vec<(i64, usize)>, String> {
        let mut csv = Csv::new("test.csv", text.as_ref(), 0.033);
        let mut instants = Vec::new();
        while let Some(input) = csv.next_input().map_err(|error| error.to_string())? {
            let Input::Positions { timestamp_ns, positions } = input else { panic!() };
            instants.push((timestamp_ns, positions.len()));
        }
        Ok(instants)
    }

    #[test]
    fn rows_of_one_time_are_one_instant() {
        assert_eq!(instants("t,x,y,z\n0,1,2,3\n0.0,4,5,6\n1e-9,1,2,3\n").unwrap(), [(0, 2), (1, 1)]);
        assert_eq!(instants("\u{feff}z, y ,colour,x,t\r\n3,2,red,1,0.5").unwrap(), [(500_000_000, 1)]);
        assert_eq!(instants("").unwrap(), []);
        assert_eq!(instants("t,x,y,z\n").unwrap(), []);
    }

    #[test]
    fn what_was_not_seen_is_an_instant_without_positions() {
        assert_eq!(instants("t,x,y,z\n0,,,\n1,nan,NaN,1\n2,1,1,1\n").unwrap(), [(0, 0), (1_000_000_000, 0), (2_000_000_000, 1)]);
    }

    #[test]
    fn labels_and_covariances_arrive() {
        let text = "t,x,y,z,track,xx,xy,xz,yy,yz,zz\n0,1,2,3,7,4e-6,1e-6,0,5e-6,0,6e-6\n";
        let mut csv = Csv::new("test.csv", text.as_bytes(), 0.02);
        let Some(Input::Positions { positions: [seen], .. }) = csv.next_input().unwrap() else { panic!() };
        assert_eq!((seen.label, seen.radius, seen.center), (Some(7), 0.02, Vec3::new(1.0, 2.0, 3.0)));
        assert_eq!(seen.covariance, Some(Mat3::new(4e-6, 1e-6, 0.0, 1e-6, 5e-6, 0.0, 0.0, 0.0, 6e-6)));
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("t,x,y\n", "line 1: no column `z`"),
            ("1,2,3,4\n", "line 1: no column `t`"),
            ("t;x;y;z\n0;1;2;3\n", "it is \"t;x;y;z\"; separate columns by `,` instead of ';'"),
            ("t\tx\ty\tz\n", "separate columns by `,` instead of '\\t'"),
            ("T,X,Y,Z\n0,1,2,3\n", "it is \"T,X,Y,Z\"; write `t` instead of `T`"),
            ("t,x,y,z,xx\n", "no column `xy`"),
            ("t,x,y,z\n0,1,2,3\n1,inf,0,0\n", "line 3: positions must be finite"),
            ("t,x,y,z\n0,1e9,2,3\n", "line 2: positions must be finite metres"),
            ("t,x,y,z\nsoon,1,2,3\n", "line 2: t = \"soon\""),
            ("t,x,y,z\n0,1,2\n", "line 2: 3 fields"),
            ("t,x,y,z\n0,1,2,3,4\n", "line 2: 5 fields, the header has 4"),
            ("t,x,y,z,z\n0,1,2,3,4\n", "line 1: two columns are called `z`"),
            ("t,x,y,z,yy,yy\n", "line 1: two columns are called `yy`"),
            ("t,x,y,z\n0,1,two,3\n", "line 2: \"two\" is no number"),
            ("t,x,y,z,track\n0,1,2,3,-1\n", "line 2: track = \"-1\""),
            (&("t,x,y,z\n".to_owned() + &"0,1,2,3\n".repeat(17)), "line 18: more than 16 positions at one time"),
            ("t,x,y,z,xx,xy,xz,yy,yz,zz\n0,1,2,3,1,2,0,1,0,1\n", "line 2: a covariance must be positive definite"),
        ] {
            let message = instants(text).unwrap_err();
            assert!(message.starts_with("test.csv: ") && message.contains(expected), "{message}");
        }
        assert!(instants(b"t,x,y,z\n\xff\xfe,1,2,3\n").unwrap_err().contains("line 2: not text"));
        assert!(instants(std::vec![b'a'; 10 << 20]).unwrap_err().contains("64 KiB"));
    }

    proptest! {
        #[test]
        fn never_panics(text in "(t,x,y,z\n)?[-0-9.,enaif\n\"]{0,80}", bytes: Vec<u8>) {
            let _ = (instants(text), instants(bytes));
        }
    }
}
