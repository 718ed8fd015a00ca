//! The outputs of all filters, to the bit, over a motion with every trouble and over a recording:
//! each as a hash. A change that is to keep the bits keeps these.

#[path = "golden/inputs.rs"]
mod inputs;

use inputs::{Input, SCALE, generated, recorded};
use tvc_fusion::filter::Real;
use tvc_fusion::{
    Attitude, Complementary, Config, Estimator, Filter, Flags, Gyro, Kalman, Madgwick, Mahony,
    MahonyGains, Quality, Sample, Vqf, fixed,
};

/// FNV-1a, a word at a time.
struct Hash(u64);

impl Hash {
    fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0100_0000_01b3).rotate_left(17);
    }

    fn words(&mut self, words: impl IntoIterator<Item = i32>) {
        for word in words {
            self.word(u64::from(word as u32));
        }
    }

    /// A scalar to its last bit, in two parts of single precision and what is left.
    fn real<T: Real>(&mut self, value: T) {
        let high = value.to_f32();
        let low = (value - T::from_f32(high)).to_f32();
        self.word(u64::from(high.to_bits()) << 32 | u64::from(low.to_bits()));
    }

    fn flags(&mut self, flags: Flags) {
        let bits = [
            flags.initialised,
            flags.at_rest,
            flags.acc_rejected,
            flags.mag_disturbed,
            flags.over_range,
            flags.skipped,
            flags.gap,
        ];
        self.word(bits.iter().fold(0, |word, bit| word << 1 | u64::from(*bit)));
    }

    fn quality<T: Real>(&mut self, quality: &Quality<T>) {
        for part in [quality.tilt_rad, quality.heading_rad, quality.bias_rad_s] {
            self.real(part);
        }
        self.real(quality.field_age_s.unwrap_or(-T::ONE));
        self.word(quality.bias as u64 | u64::from(quality.heading_is_observable) << 8);
    }

    fn attitude<T: Real>(&mut self, attitude: &Attitude<T>) {
        let q = &attitude.orientation;
        for part in [q.w, q.x, q.y, q.z] {
            self.real(part);
        }
        for vector in [&attitude.rate, &attitude.bias] {
            for part in vector.iter() {
                self.real(*part);
            }
        }
        self.flags(attitude.flags);
    }
}

/// Every value that the float filters are given, now and then with one that is no number.
fn sample(index: usize, input: &Input) -> Sample {
    let vector = |counts: [i16; 3], unit: f32| counts.map(|c| f32::from(c) * unit);
    let mut sample = Sample {
        gyr: vector(input.counts.gyr, SCALE.gyr_rad_s),
        acc: vector(input.counts.acc, SCALE.acc_m_s2),
        mag: input.counts.mag.map(|mag| vector(mag, SCALE.mag_ut)),
    };
    match index {
        7_000 => sample.gyr[1] = f32::NAN,
        7_100 => sample.acc[2] = f32::INFINITY,
        7_200 => sample.mag = Some([f32::NAN, 0.0, 0.0]),
        _ => {}
    }
    sample
}

fn float<F: Filter>(config: &Config<F::Gains>, inputs: &[Input]) -> u64 {
    let mut estimator = Estimator::<F>::new(config).expect("in range");
    let mut hash = Hash::new();
    for (index, input) in inputs.iter().enumerate() {
        let attitude = estimator.update(input.dt_us as f32 * 1e-6, &sample(index, input));
        hash.attitude(&attitude);
        if index % 50 == 0 {
            hash.quality(&estimator.quality());
            hash.real(estimator.mag_lag_s());
        }
    }
    hash.0
}

/// What is known is taken, given back and set while the filter runs.
fn handled<F: Filter>(config: &Config<F::Gains>, inputs: &[Input]) -> u64 {
    let mut estimator = Estimator::<F>::new(config).expect("in range");
    let mut hash = Hash::new();
    for (index, input) in inputs.iter().enumerate() {
        match index {
            2_000 => estimator.set_heading(F::Real::from_f32(1.0)),
            2_500 => estimator.set_gains(&config.gains).expect("as before"),
            3_000 => {
                let state = estimator.state();
                estimator = Estimator::new(config).expect("as before");
                estimator.restore(&state).expect("as it was taken");
            }
            4_000 => estimator.reset(),
            4_500 => {
                let bias = estimator.attitude().bias;
                estimator.set_bias(bias.map(|axis| axis * F::Real::HALF));
            }
            _ => {}
        }
        let sample = sample(index, input);
        let attitude = estimator.update(input.dt_us as f32 * 1e-6, &sample);
        hash.attitude(&attitude);
        for vector in [
            attitude.gravity(),
            attitude.linear_acceleration(&sample.acc),
            attitude.earth_acceleration(&sample.acc),
        ] {
            for part in vector.iter() {
                hash.real(*part);
            }
        }
        let euler = attitude.orientation.euler();
        for angle in [euler.roll_rad, euler.pitch_rad, euler.yaw_rad] {
            hash.real(angle);
        }
    }
    hash.0
}

fn in_fixed<F: fixed::Filter, S: fixed::Sensors>(
    estimator: fixed::Estimator<F, S>,
    inputs: &[Input],
) -> u64 {
    let (mut hash, mut state) = (Hash::new(), estimator.start());
    for (index, input) in inputs.iter().enumerate() {
        if index == 2_500 {
            estimator.level(&mut state);
        }
        if (5_000..5_200).contains(&index) {
            estimator.coast(&mut state, input.dt_us, &input.counts.gyr);
        } else {
            estimator.update(&mut state, input.dt_us, &input.counts);
        }
        let orientation = estimator.orientation(&state);
        hash.words(orientation.wxyz_q30);
        hash.words(estimator.bias_q9(&state));
        hash.flags(estimator.flags(&state));
        hash.word(estimator.tilt_is_within(&state, 100_000).into());
        if index % 50 == 0 {
            hash.quality(&estimator.quality(&state));
            hash.attitude(&estimator.attitude(&state, &input.counts.gyr));
            let angles = orientation.angles();
            hash.words([angles.roll, angles.pitch, angles.yaw, orientation.pitch()]);
            hash.words(orientation.tilt_q28());
        }
    }
    hash.0
}

type Hashes = Vec<(String, u64)>;

fn float_of<F: Filter>(name: &str, hashes: &mut Hashes)
where
    F::Gains: Default,
{
    let (motion, recording) = (generated(), recorded());
    let mut config = Config::<F::Gains>::default();
    hashes.push((format!("{name}, motion"), float::<F>(&config, &motion)));
    hashes.push((format!("{name}, recording"), float::<F>(&config, &recording)));
    config = config.without_lags();
    config.declination_rad = 0.1;
    config.acc_gate = 0.3;
    config.field.adopt_s = 3.0;
    config.rest.motion_tilt_rad = f32::INFINITY;
    hashes.push((format!("{name}, handled"), handled::<F>(&config, &motion)));
}

fn fixed_of<F: fixed::Filter>(name: &str, hashes: &mut Hashes)
where
    F::Gains: Default,
{
    let ideal = {
        let mut config = Config::<F::Gains>::default().without_lags();
        config.field.adopt_s = 3.0;
        config
    };
    let late = Config::<F::Gains> { declination_rad: 0.1, ..Config::default() };
    for (inputs_name, inputs, period_us) in
        [("motion", generated(), 10_000), ("recording", recorded(), 3_500)]
    {
        let ideal = fixed::Estimator::<F, fixed::Ideal>::new(&ideal, &SCALE, period_us);
        let known = fixed::Estimator::<F, fixed::Late>::new(&late, &SCALE, period_us);
        for (variant, hash) in [
            ("prompt", in_fixed(ideal.expect("in range"), &inputs)),
            ("late", in_fixed(known.expect("in range"), &inputs)),
        ] {
            hashes.push((format!("{name} {variant}, {inputs_name}"), hash));
        }
    }
}

fn compare(name: &str, hashes: &Hashes) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/");
    let path = format!("{folder}{name}.txt");
    let now: String = hashes.iter().map(|(name, hash)| format!("{hash:016x} {name}\n")).collect();
    if std::env::var_os("GOLDEN").is_some_and(|value| value == "overwrite") {
        std::fs::write(&path, now).expect("the folder is writable");
        return;
    }
    let golden = std::fs::read_to_string(&path).expect("it is in the repository");
    let differ: Vec<_> =
        golden.lines().zip(now.lines()).filter(|(golden, now)| golden != now).collect();
    assert!(
        differ.is_empty() && golden.lines().count() == now.lines().count(),
        "these bits have changed; GOLDEN=overwrite takes them over: {differ:#?}"
    );
}

#[test]
fn float_filters_keep_their_bits() {
    let mut hashes = Vec::new();
    float_of::<Gyro<f32>>("gyro f32", &mut hashes);
    float_of::<Complementary<f32>>("complementary f32", &mut hashes);
    float_of::<Mahony<f32>>("mahony f32", &mut hashes);
    float_of::<Madgwick<f32>>("madgwick f32", &mut hashes);
    float_of::<Vqf<f32>>("vqf f32", &mut hashes);
    float_of::<Kalman<f32>>("kalman f32", &mut hashes);
    float_of::<Gyro<f64>>("gyro f64", &mut hashes);
    float_of::<Complementary<f64>>("complementary f64", &mut hashes);
    float_of::<Mahony<f64>>("mahony f64", &mut hashes);
    float_of::<Madgwick<f64>>("madgwick f64", &mut hashes);
    float_of::<Vqf<f64>>("vqf f64", &mut hashes);
    float_of::<Kalman<f64>>("kalman f64", &mut hashes);
    let integral =
        Config::with_gains(MahonyGains { integral_per_s2: 0.01, ..MahonyGains::default() });
    let hash = float::<Mahony<f32>>(&integral, &generated());
    hashes.push(("mahony f32 with integral, motion".into(), hash));
    compare("float", &hashes);
}

#[test]
fn fixed_point_filters_keep_their_bits() {
    let mut hashes = Vec::new();
    fixed_of::<fixed::Complementary>("complementary", &mut hashes);
    fixed_of::<fixed::Mahony>("mahony", &mut hashes);
    fixed_of::<fixed::Madgwick>("madgwick", &mut hashes);
    fixed_of::<fixed::Vqf>("vqf", &mut hashes);
    compare("fixed", &hashes);
}

#[cfg(feature = "offline")]
#[test]
fn both_directions_of_time_keep_their_bits() {
    use tvc_fusion::offline::{TimedSample, smooth};

    fn hash<F: Filter>(inputs: &[Input]) -> u64
    where
        F::Gains: Default,
    {
        let samples: Vec<_> = inputs
            .iter()
            .enumerate()
            .map(|(index, input)| TimedSample {
                dt_s: input.dt_us as f32 * 1e-6,
                sample: sample(index, input),
            })
            .collect();
        let mut hash = Hash::new();
        for attitude in smooth::<F>(&Config::default(), &samples).expect("in range") {
            hash.attitude(&attitude);
        }
        hash.0
    }
    let mut hashes = Vec::new();
    for (name, inputs) in [("motion", generated()), ("recording", recorded())] {
        hashes.push((format!("vqf f32, {name}"), hash::<Vqf>(&inputs)));
        hashes.push((format!("kalman f64, {name}"), hash::<Kalman<f64>>(&inputs)));
    }
    compare("offline", &hashes);
}
