//! The control laws that are measured, each held to the same law on the host: an update must give
//! the same output, bit for bit.

use std::fmt;

use anyhow::{Result, ensure};
use recordings::Scalar;
use rig::Image;
use tvc_pid::{Controller, Pd, Pid, Q16, Surface};

use super::Run;
use super::bench::Bench;
use super::readings::{self, Hard, Step};

/// One law in one scalar.
pub struct Law {
    /// What the law is called, whatever it computes in.
    pub name: &'static str,
    /// What it computes in.
    pub scalar: Scalar,
    /// The law at rest, on the host.
    pub make: fn() -> Box<dyn ::cycles::Law>,
    /// The word of a number.
    pub word: fn(f32) -> u32,
    /// The number of a word.
    pub number: fn(u32) -> f32,
}

impl Law {
    fn of<L: ::cycles::Law + 'static, T: ::cycles::Number>(
        name: &'static str,
        scalar: Scalar,
    ) -> Self {
        Self {
            name,
            scalar,
            make: || Box::new(L::new()),
            word: |number| T::from(number).to_word(),
            number: |word| T::from_word(word).into(),
        }
    }

    /// Its name on the command line, which no other law has.
    pub fn full_name(&self) -> String {
        match self.scalar {
            Scalar::Fixed => format!("fixed-{}", self.name),
            _ => self.name.to_owned(),
        }
    }

    /// The feature of the package `cycles` that stands for it.
    pub fn feature(&self) -> String {
        format!("law-{}", self.full_name())
    }

    /// Whether two outputs are the same. Rust leaves open which of its bit patterns a NaN has.
    fn is_same(&self, a: u32, b: u32) -> bool {
        let is_nan = |word| (self.number)(word).is_nan();
        a == b || is_nan(a) && is_nan(b)
    }
}

impl fmt::Display for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.name, self.scalar)
    }
}

/// Every law that can be measured.
pub fn all() -> Vec<Law> {
    use Scalar::{F32, Fixed};
    vec![
        Law::of::<Pd<f32>, f32>("pd", F32),
        Law::of::<Pd<Q16>, Q16>("pd", Fixed),
        Law::of::<Controller<f32, Pid<f32>>, f32>("pid", F32),
        Law::of::<Controller<Q16, Pid<Q16>>, Q16>("pid", Fixed),
        Law::of::<Controller<f32, Surface<f32>>, f32>("surface", F32),
        Law::of::<Controller<Q16, Surface<Q16>>, Q16>("surface", Fixed),
    ]
}

/// Runs a law's image without and with a flash wait state.
pub fn measure(law: &Law, image: &Image) -> Result<[Run; 2]> {
    let release = readings::release(law);
    let hard = readings::hard(law, &release);
    super::without_and_with_wait_state(|wait_states| {
        run_image(law, image, wait_states, &release, &hard)
    })
}

fn run_image(
    law: &Law,
    image: &Image,
    wait_states: u8,
    release: &[Step],
    hard: &[Hard],
) -> Result<Run> {
    let mut run = Run::default();
    let mut play = |bench: &mut Bench, name, steps: &[Step]| {
        run.play(bench, name, steps, |bench, index, step| update(law, bench, step, (index, name)))
    };
    let fresh = Bench::boot(image, wait_states)?;
    let mut bench = fresh.clone();
    let total = play(&mut bench, "the release", release)?;
    for sort in hard {
        play(&mut bench.clone(), sort.name, &sort.after_release)?;
        play(&mut fresh.clone(), sort.name, &sort.from_rest)?;
    }
    run.mean = total as f64 / release.len() as f64;
    Ok(run)
}

/// Gives the chip what the host was given, and compares what they put out.
fn update(law: &Law, bench: &mut Bench, step: &Step, (index, name): (usize, &str)) -> Result<u64> {
    let cycles = bench.update(&step.input.words())?;
    let (chip, host) = (bench.returned(), step.output);
    ensure!(
        law.is_same(chip, host),
        "update {index} of {name}: the chip puts out {} (0x{chip:08x}) and the host {} (0x{host:08x})",
        (law.number)(chip),
        (law.number)(host)
    );
    Ok(cycles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_law_has_a_feature_of_the_package_that_builds_it_and_no_other_has_one() {
        let mut features: Vec<_> = include_str!("../../../cycles/Cargo.toml")
            .lines()
            .filter_map(|line| line.split_once(" = ["))
            .map(|(name, _)| name.to_owned())
            .filter(|name| name.starts_with("law-"))
            .collect();
        let mut wanted: Vec<_> = all().iter().map(Law::feature).collect();
        features.sort();
        wanted.sort();
        assert_eq!(wanted, features);
    }

    #[test]
    fn outputs_differ_by_a_bit_and_not_by_the_sort_of_nan() {
        let laws = all();
        let [float, fixed] = &laws[..2] else { panic!() };
        assert!(float.is_same(0x7fc0_0000, 0xffc0_0001));
        assert!(!float.is_same(0.0_f32.to_bits(), (-0.0_f32).to_bits()));
        assert!(!fixed.is_same(0x7fc0_0000, 0x7fc0_0001));
    }
}
