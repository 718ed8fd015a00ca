//! Recordings as CSV: columns by name, units in the names; or, without units, the counts of a
//! BNO055.

use std::io::{Chain, Cursor, Read};

use csv::{ByteRecord, Reader, ReaderBuilder};
use tvc_fusion::GRAVITY;

use crate::{RecordedSample, RecordingError, bno055};

const DEG: f64 = std::f64::consts::PI / 180.0;

/// Units that a column's name may end in, and what one of them is in SI (and uT).
const TIME: [(&str, f64); 3] = [("t_s", 1.0), ("t_ms", 1e-3), ("t_us", 1e-6)];
const RATE: [(&str, f64); 2] = [("_rad_s", 1.0), ("_deg_s", DEG)];
const FORCE: [(&str, f64); 2] = [("_m_s2", 1.0), ("_g", GRAVITY as f64)];
const FIELD: [(&str, f64); 2] = [("_ut", 1.0), ("_gauss", 100.0)];
const REFERENCE: [&str; 4] = ["ref_w", "ref_x", "ref_y", "ref_z"];

/// Names of the time beside columns of counts.
const COUNTS_TIME: [(&str, f64); 3] = [("sample_time_us", 1e-6), ("time_us", 1e-6), ("t_s", 1.0)];

/// A CSV file, line by line.
pub(crate) struct Table<R> {
    name: String,
    reader: Reader<Chain<Cursor<Vec<u8>>, R>>,
    record: ByteRecord,
    columns: Columns,
    last_mag: Option<[f64; 3]>,
}

struct Columns {
    time: (usize, f64),
    gyr: Vector,
    acc: Vector,
    mag: Option<Vector>,
    reference: Option<[usize; 4]>,
    movement: Option<usize>,
    are_counts: bool,
}

/// Three columns and the unit of all of them.
#[derive(Clone, Copy)]
struct Vector {
    columns: [usize; 3],
    unit: f64,
}

impl<R: Read> Table<R> {
    /// Reads the names of the columns; `start` is what has been read of the file already.
    ///
    /// # Errors
    /// Columns that are needed are missing.
    pub(crate) fn read(name: &str, start: Vec<u8>, rest: R) -> Result<Self, RecordingError> {
        let mut reader =
            ReaderBuilder::new().trim(csv::Trim::All).from_reader(Cursor::new(start).chain(rest));
        let foreign = |reason: String| {
            RecordingError::of(
                name,
                format!(
                    "is neither an IMUQ16v1 recording nor a CSV file with columns such as \
                     t_s,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2: {reason}"
                ),
            )
        };
        let header = reader.headers().map_err(|_| foreign("its first line is no text".into()))?;
        let names: Vec<String> = header.iter().map(str::to_ascii_lowercase).collect();
        let columns = Columns::find(&names).map_err(foreign)?;
        Ok(Self {
            name: name.to_owned(),
            reader,
            record: ByteRecord::new(),
            columns,
            last_mag: None,
        })
    }

    /// Whether its columns are counts of a BNO055.
    pub(crate) fn is_counts(&self) -> bool {
        self.columns.are_counts
    }

    /// How much of the file has been read.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.reader.position().byte()
    }

    /// The next sample; `None` after the last.
    ///
    /// # Errors
    /// Lines that differ in their number of fields, or hold something else than numbers.
    pub(crate) fn next_sample(&mut self) -> Result<Option<RecordedSample>, RecordingError> {
        loop {
            let more = self.reader.read_byte_record(&mut self.record);
            let damaged = |error| RecordingError::of(&self.name, format!("is damaged: {error}"));
            if !more.map_err(damaged)? {
                return Ok(None);
            }
            let [first, ..] = self.columns.gyr.columns;
            if self.is_counts() && self.record.get(first).is_none_or(<[u8]>::is_empty) {
                // A control step that had no sample.
                continue;
            }
            let sample = self.columns.sample(&self.record).map_err(|reason| {
                let line = self.record.position().map_or(0, csv::Position::line);
                RecordingError::Unusable(format!("{}, line {line}: {reason}", self.name))
            })?;
            // The registers repeat until the magnetometer has measured again.
            let repeats = self.is_counts() && sample.mag_ut == self.last_mag;
            self.last_mag = sample.mag_ut;
            return Ok(Some(RecordedSample {
                mag_ut: sample.mag_ut.filter(|_| !repeats),
                ..sample
            }));
        }
    }
}

impl Columns {
    fn find(names: &[String]) -> Result<Self, String> {
        let at = |name: &str| names.iter().position(|column| column == name);
        let time_in = |names: &[(&str, f64)]| {
            let mut names = names.iter();
            names.find_map(|(name, unit)| Some((at(name)?, *unit)))
        };
        let vector = |prefix: &str, suffix: &str, unit: f64| {
            let [x, y, z] = ["x", "y", "z"].map(|axis| at(&format!("{prefix}{axis}{suffix}")));
            Some(Vector { columns: [x?, y?, z?], unit })
        };
        let [w, x, y, z] = REFERENCE.map(at);
        let reference = (|| Some([w?, x?, y?, z?]))();
        let movement = at("movement");
        let counts = || {
            Some(Self {
                time: time_in(&COUNTS_TIME)?,
                gyr: vector("gyr_", "", bno055::GYR_RAD_S)?,
                acc: vector("acc_", "", bno055::ACC_M_S2)?,
                mag: Some(vector("mag_", "", bno055::MAG_UT)?),
                reference,
                movement,
                are_counts: true,
            })
        };
        if let Some(counts) = counts() {
            return Ok(counts);
        }
        let any_of = |letter: &str, units: &[(&str, f64)]| {
            let mut units = units.iter();
            units.find_map(|(suffix, unit)| vector(letter, suffix, *unit))
        };
        let needed = |letter, units: &[(&str, f64)]| {
            any_of(letter, units).ok_or_else(|| {
                format!("it has no columns {letter}x{0} to {letter}z{0}", units[0].0)
            })
        };
        Ok(Self {
            time: time_in(&TIME).ok_or("it has no column t_s")?,
            gyr: needed("g", &RATE)?,
            acc: needed("a", &FORCE)?,
            mag: any_of("m", &FIELD),
            reference,
            movement,
            are_counts: false,
        })
    }

    fn sample(&self, record: &ByteRecord) -> Result<RecordedSample, String> {
        let (column, unit) = self.time;
        let time_s = number(record, column)? * unit;
        if !time_s.is_finite() {
            return Err("the time is not a number".into());
        }
        let mag_ut = self.mag.map(|mag| mag.read(record)).transpose()?;
        let reference = self.reference.map(|columns| numbers(record, columns)).transpose()?;
        Ok(RecordedSample {
            time_s,
            gyr_rad_s: self.gyr.read(record)?,
            acc_m_s2: self.acc.read(record)?,
            mag_ut: mag_ut.filter(|mag| mag.iter().all(|m| m.is_finite()) && *mag != [0.0; 3]),
            reference: reference.filter(|q| {
                let norm = q.iter().map(|c| c * c).sum::<f64>();
                norm.is_finite() && norm > 0.0
            }),
            movement: match self.movement {
                Some(column) => number(record, column)? > 0.5,
                None => true,
            },
        })
    }
}

impl Vector {
    fn read(&self, record: &ByteRecord) -> Result<[f64; 3], String> {
        Ok(numbers(record, self.columns)?.map(|number| number * self.unit))
    }
}

fn numbers<const N: usize>(record: &ByteRecord, columns: [usize; N]) -> Result<[f64; N], String> {
    let mut numbers = [0.0; N];
    for (read, column) in numbers.iter_mut().zip(columns) {
        *read = number(record, column)?;
    }
    Ok(numbers)
}

/// An empty field is no number: NaN.
fn number(record: &ByteRecord, column: usize) -> Result<f64, String> {
    let field = record.get(column).unwrap_or_default();
    if field.is_empty() {
        return Ok(f64::NAN);
    }
    std::str::from_utf8(field)
        .ok()
        .and_then(|text| text.parse().ok())
        .ok_or_else(|| format!("{} is not a number", String::from_utf8_lossy(field)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<Table<&'static [u8]>, RecordingError> {
        Table::read("log.csv", text.as_bytes().to_vec(), &[][..])
    }

    fn said<T>(result: Result<T, RecordingError>) -> String {
        match result {
            Ok(_) => panic!("accepted"),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn units_are_those_of_the_names_and_columns_stand_in_any_order() {
        let text = "az_g,ay_g,ax_g,T_ms,note,gx_deg_s,gy_deg_s,gz_deg_s,mx_gauss,my_gauss,mz_gauss\n\
                    1,0,0,2500,hello,180,0,0,0.5,0,0\n";
        let row = table(text).unwrap().next_sample().unwrap().unwrap();
        assert_eq!(row.time_s, 2.5);
        assert!((row.gyr_rad_s[0] - std::f64::consts::PI).abs() < 1e-12);
        assert!((row.acc_m_s2[2] - 9.806_65).abs() < 1e-6);
        assert_eq!(row.mag_ut, Some([50.0, 0.0, 0.0]));
        assert_eq!((row.reference, row.movement), (None, true));
    }

    const HEAD: &str = "t_s,gx_rad_s,gy_rad_s,gz_rad_s,ax_m_s2,ay_m_s2,az_m_s2,mx_ut,my_ut,mz_ut,\
                        ref_w,ref_x,ref_y,ref_z,movement\n";

    #[test]
    fn an_empty_field_and_an_empty_reference_are_none() {
        let mut table = table(&format!(
            "{HEAD}0,0,0,0,0,0,9.8,,,,,,,,0\n0.01,0,0,0,0,0,9.8,20,0,-40,1,0,0,0,1\n"
        ))
        .unwrap();
        let first = table.next_sample().unwrap().unwrap();
        assert_eq!((first.mag_ut, first.reference, first.movement), (None, None, false));
        let second = table.next_sample().unwrap().unwrap();
        assert_eq!(second.mag_ut, Some([20.0, 0.0, -40.0]));
        assert_eq!(second.reference, Some([1.0, 0.0, 0.0, 0.0]));
        assert!(second.movement && table.next_sample().unwrap().is_none());
    }

    #[test]
    fn counts_are_those_of_a_bno055_with_steps_without_a_sample_and_repeated_fields() {
        let text = "time_us,sample_time_us,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z,mag_x,mag_y,mag_z\n\
                    5,1000000,0,0,-981,160,0,0,320,0,-640\n\
                    6,,,,,,,,,,\n\
                    7,1010000,0,0,-981,0,0,0,320,0,-640\n";
        let mut table = table(text).unwrap();
        let first = table.next_sample().unwrap().unwrap();
        assert_eq!((first.time_s, first.acc_m_s2[2]), (1.0, -9.81));
        assert_eq!(first.gyr_rad_s[0], 10.0 * DEG);
        assert_eq!(first.mag_ut, Some([20.0, 0.0, -40.0]));
        let second = table.next_sample().unwrap().unwrap();
        assert_eq!((second.time_s, second.mag_ut), (1.01, None));
        assert!(table.is_counts() && table.next_sample().unwrap().is_none());
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        assert!(said(table("a,b\n1,2\n")).contains("no column t_s"));
        assert!(said(table("t_s,gx_rad_s\n")).contains("gx_rad_s to gz_rad_s"));
        assert!(said(table("\u{fffd}")).contains("neither an IMUQ16v1"));
        let mut text = table(&format!("{HEAD}0,0,x,0,0,0,9.8,,,,,,,,0\n")).unwrap();
        assert!(said(text.next_sample()).contains("line 2: x is not a number"));
        let mut short = table(&format!("{HEAD}0,0,0\n")).unwrap();
        assert!(said(short.next_sample()).contains("damaged"));
        let mut timeless = table(&format!("{HEAD},0,0,0,0,0,9.8,,,,,,,,0\n")).unwrap();
        assert!(said(timeless.next_sample()).contains("line 2: the time"));
    }
}
