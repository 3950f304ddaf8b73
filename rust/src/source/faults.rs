//! What may happen to packets, and how often.

use std::format;
use std::string::String;

/// How often what happens: probabilities for each packet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// It never comes.
    pub lose: f64,
    /// Mean length of a run of lost packets, from 1 on.
    pub burst: f64,
    /// It comes without its bytes.
    pub empty: f64,
    /// It comes without some of its last bytes.
    pub short: f64,
    /// It comes twice.
    pub double: f64,
    /// One comes before it that is none of depth's: a video packet, or noise.
    pub foreign: f64,
    /// It comes after up to 16 that were sent later.
    pub late: f64,
    /// One of its bits is the other, anywhere.
    pub flip: f64,
    /// From it on nothing comes for 1.5 s.
    pub silence: f64,
    /// Which faults of all that are so frequent.
    pub seed: u64,
}

impl Faults {
    /// From `lose=0.05&burst=10&seed=3`.
    ///
    /// # Errors
    /// What is wrong with it, in one line.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut faults = Self { burst: 1.0, ..Self::default() };
        for pair in text.split('&') {
            let (key, value) = pair.split_once('=').ok_or_else(|| format!("`{pair}` is not key=value"))?;
            if key == "seed" {
                faults.seed = value.parse().map_err(|_| format!("seed={value}: an integer from 0 on is expected"))?;
                continue;
            }
            let (range, expected) =
                if key == "burst" { (1.0..=1e6, "a mean length, 1 to 1e6 packets,") } else { (0.0..=1.0, "a probability") };
            let rate = match key {
                "lose" => &mut faults.lose,
                "burst" => &mut faults.burst,
                "empty" => &mut faults.empty,
                "short" => &mut faults.short,
                "double" => &mut faults.double,
                "foreign" => &mut faults.foreign,
                "late" => &mut faults.late,
                "flip" => &mut faults.flip,
                "silence" => &mut faults.silence,
                _ => return Err(format!("no fault `{key}`: lose, burst, empty, short, double, foreign, late, flip, silence, or seed")),
            };
            let number = value.parse().ok().filter(|number| range.contains(number));
            *rate = number.ok_or_else(|| format!("{key}={value}: {expected} is expected"))?;
        }
        Ok(faults)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_they_are_written() {
        let expected = Faults { lose: 0.05, burst: 10.0, seed: 3, ..Faults::default() };
        assert_eq!(Faults::parse("lose=0.05&burst=10&seed=3"), Ok(expected));
        for (text, message) in [
            ("lose", "not key=value"),
            ("", "not key=value"),
            ("loose=1", "no fault `loose`"),
            ("lose=5", "a probability is expected"),
            ("lose=NaN", "a probability is expected"),
            ("burst=0", "a mean length"),
            ("seed=-1", "an integer"),
        ] {
            assert!(Faults::parse(text).is_err_and(|what| what.contains(message)), "{text}");
        }
    }
}
