//! Functions of the firmware that can come to themselves again, how often, and why not more often.

use super::depth::Bounded;

/// Function, how often it is on the stack at once, and why not more often.
const KNOWN: [(&str, u8, &str); 1] = [(
    "core::fmt::write",
    4,
    "a text shows a value that shows a value: at most a refusal or state, its cause, and a \
         number (src/failsafe, src/params, bno055-driver/src/fault.rs), which is 3; none shows one \
         of its own type",
)];

/// Those of the firmware, and those of the command line in the place of their own.
pub fn bounds(given: &[Bounded]) -> Vec<Bounded> {
    let known = KNOWN.iter().map(|(function, times, why)| Bounded {
        function: (*function).into(),
        times: *times,
        why: (*why).into(),
    });
    let is_given = |one: &Bounded| given.iter().any(|other| other.function == one.function);
    let mut all: Vec<_> = known.filter(|one| !is_given(one)).collect();
    all.extend_from_slice(given);
    all
}

/// Parses `FUNCTION=TIMES`.
///
/// # Errors
/// What such a bound looks like.
pub fn bound(text: &str) -> Result<Bounded, String> {
    let parsed = text.rsplit_once('=').and_then(|(function, times)| {
        let times = times.parse().ok().filter(|times| (1..=16).contains(times))?;
        let why = "given by --bound".into();
        (!function.is_empty()).then(|| Bounded { function: function.into(), times, why })
    });
    parsed.ok_or_else(|| {
        "a bound is the name of a function and how often it is on the stack at once, 1 to 16, \
         such as core::fmt::write=4"
            .into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_given_bound_replaces_the_known_one() {
        let given = bound("core::fmt::write=2").unwrap();
        assert_eq!((given.function.as_str(), given.times), ("core::fmt::write", 2));
        let all = bounds(&[given]);
        let of_write = all.iter().filter(|one| one.function == "core::fmt::write");
        assert_eq!(of_write.map(|one| one.times).collect::<Vec<_>>(), [2]);
        let other = bounds(&[bound("another=3").unwrap()]);
        assert_eq!(other.len(), all.len() + 1);
    }

    #[test]
    fn a_bound_is_a_name_and_a_number() {
        for bad in ["f", "f=", "=3", "f=0", "f=17", "f=x", "f=-1"] {
            assert!(bound(bad).is_err(), "{bad}");
        }
    }
}
