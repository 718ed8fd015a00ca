//! Vehicles by name, or from a TOML file: what the model and the rig need to know of them.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, anyhow, bail};
use plant::pitch_loop::Timing;
use plant::rocket::{Motor, RocketParameters};
use plant::setup::{SetupError, section};
use plant::{Parameters, ServoModel, Setup};
use rig::bench::{TwoAxes, VehicleConfig};
use rig::rocket::{self, Airframe, Conditions, Mounting, RocketLaw};
use rig::{RigConfig, ServoKind};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};
use tvc_nano::Params;

use report::exit::BadInput;
use report::input;

/// What kind of vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VehicleKind {
    /// The tethered drone: it pitches, and has one rudder.
    #[default]
    Drone,
    /// The same in a joint, with two rudders: it pitches, rolls and spins.
    Drone2,
    /// A rocket through its burn: it stands on its pad, and its gimbal is steered about two axes.
    Rocket,
}

impl VehicleKind {
    /// Those that fly from a clamp.
    pub const DRONES: [Self; 2] = [Self::Drone, Self::Drone2];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drone => "drone",
            Self::Drone2 => "drone2",
            Self::Rocket => "rocket",
        }
    }
}

/// What `--vehicle` says.
#[derive(Clone, Debug, PartialEq)]
pub enum VehicleChoice {
    /// A vehicle that the tool knows.
    Known(VehicleKind),
    /// One that a TOML file describes.
    File(PathBuf),
}

impl Default for VehicleChoice {
    fn default() -> Self {
        Self::Known(VehicleKind::Drone)
    }
}

impl FromStr for VehicleChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.ends_with(".toml") {
            return Ok(Self::File(text.into()));
        }
        clap::ValueEnum::from_str(text, false).map(Self::Known).map_err(|_| {
            "a vehicle is drone, drone2, rocket or a file that ends in .toml".to_owned()
        })
    }
}

impl VehicleChoice {
    /// The file.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Known(_) => None,
            Self::File(path) => Some(path),
        }
    }

    /// The vehicle; a drone with this servo and the firmware's timing where its file says nothing
    /// else.
    ///
    /// # Errors
    /// A file that cannot be used.
    pub fn read(&self, servo: ServoKind) -> Result<Vehicle> {
        self.read_over(setup(servo))
    }

    /// The drone, or either axis of one with two, with this servo and the firmware's timing.
    ///
    /// # Errors
    /// A file that cannot be used; a rocket.
    pub fn drone(&self, servo: ServoKind) -> Result<Setup> {
        self.read(servo)?.drone()
    }

    /// The rockets that are meant.
    ///
    /// # Errors
    /// As [`Self::drone`].
    pub fn rockets(&self) -> Result<Vec<Airframe>> {
        let vehicle = self.read_over(Setup::default())?;
        if vehicle.kind != VehicleKind::Rocket {
            bail!(BadInput::new("--vehicle: this command is for rockets"));
        }
        Ok(vehicle.airframes)
    }

    /// The vehicle, with what its file leaves out as in `base`.
    ///
    /// # Errors
    /// A file that cannot be used.
    pub fn read_over(&self, base: Setup) -> Result<Vehicle> {
        let path = match self {
            Self::File(path) => path,
            Self::Known(kind) => {
                return Ok(Vehicle {
                    kind: *kind,
                    setup: base,
                    two_axes: TwoAxes::default(),
                    airframes: vec![Airframe::stable(), Airframe::unstable()],
                });
            }
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let motor = |motor: &str| Ok(input::file_text(&folder.join(motor))?);
        let vehicle = Vehicle::parse(&input::file_text(path)?, &name, base, motor);
        Ok(vehicle.map_err(|error| BadInput::of(path, error))?)
    }
}

/// The recommended drone with a servo and the firmware's timing.
fn setup(servo: ServoKind) -> Setup {
    let (servo, timing) = match servo {
        ServoKind::S3003 => (ServoModel::S3003, Timing::NANO_50HZ),
        ServoKind::Digital => (ServoModel::DIGITAL, Timing::NANO_300HZ),
    };
    Setup { drone: Parameters::PHYS, servo, timing }
}

/// A vehicle.
#[derive(Clone, Debug)]
pub struct Vehicle {
    /// Its kind.
    pub kind: VehicleKind,
    /// A drone's masses, servo and timing.
    pub setup: Setup,
    /// What a drone with two rudders has besides.
    pub two_axes: TwoAxes,
    /// Rockets that are flown.
    pub airframes: Vec<Airframe>,
}

impl Vehicle {
    /// The drone, or either axis of one with two.
    ///
    /// # Errors
    /// It is a rocket.
    pub fn drone(&self) -> Result<Setup> {
        if self.kind == VehicleKind::Rocket {
            bail!(BadInput::new(
                "--vehicle: this command is for drones; `tvc fly` and `tvc tune` take rockets"
            ));
        }
        Ok(self.setup)
    }

    /// Reads a vehicle's file; what it leaves out of a drone is as in `base`. A motor's file is
    /// read by `read`.
    ///
    /// # Errors
    /// What is wrong with the file, or a motor's file that cannot be read.
    pub fn parse(
        text: &str,
        name: &str,
        base: Setup,
        read: impl Fn(&str) -> Result<String>,
    ) -> Result<Self> {
        let mut file: Table =
            text.parse().map_err(|error: toml::de::Error| SetupError::Syntax(error.to_string()))?;
        if file.is_empty() {
            bail!("no vehicle in it: neither [drone] nor [rocket], nor another table");
        }
        let mut vehicle = Self {
            kind: VehicleKind::Drone,
            setup: base,
            two_axes: TwoAxes::default(),
            airframes: Vec::new(),
        };
        if file.contains_key("rocket") {
            vehicle.kind = VehicleKind::Rocket;
            vehicle.airframes = vec![rocket_of(&mut file, name, read)?];
        } else {
            vehicle.setup = Setup::take(&mut file, &base)?;
            if file.contains_key("two_axes") {
                vehicle.kind = VehicleKind::Drone2;
                vehicle.two_axes = section(&mut file, "two_axes", Some(TwoAxes::default()), &[])?;
            }
        }
        match file.keys().next() {
            Some(name) => Err(SetupError::UnknownTable(name.clone()).into()),
            None => Ok(vehicle),
        }
    }

    /// A drone's file, every key written out; [`Vehicle::parse`] reads it back.
    pub fn to_toml(&self) -> String {
        let drone = self.setup.to_toml();
        if self.kind != VehicleKind::Drone2 {
            return drone;
        }
        let two_axes = toml::to_string(&self.two_axes).expect("numbers are always TOML");
        format!("{drone}\n[two_axes]\n{two_axes}")
    }

    /// Hangs it on the bench. Where parameters are stored, those that its image needs are, too.
    ///
    /// # Errors
    /// A parameter that is out of the firmware's range.
    pub fn hang(&self, rig: &mut RigConfig) -> Result<()> {
        rig.bench.parameters = self.setup.drone;
        rig.bench.servo = self.setup.servo;
        let parameters = match (self.kind, self.airframes.first()) {
            (VehicleKind::Rocket, Some(airframe)) => {
                rig.bench.vehicle = VehicleConfig::Rocket(Box::new(airframe.on_pad(rig.seed)));
                let per_g_deg_s = rig.hardware.gyro_per_g_deg_s;
                let gyroscope = rocket::calibrated(per_g_deg_s, rig.seed);
                let mut all = rocket::parameters(airframe, RocketLaw::Scheduled);
                all.extend(gyroscope);
                all
            }
            (VehicleKind::Drone2, _) => {
                rig.bench.vehicle = VehicleConfig::TwoAxes(self.two_axes);
                // A Nano fresh from its box knows of one axis only.
                vec![("AXES".to_owned(), 2.0), ("SRV2_POLARITY".to_owned(), 1.0)]
            }
            _ => Vec::new(),
        };
        rig.stored.as_mut().map_or(Ok(()), |stored| store(stored, parameters))
    }
}

/// Puts parameters among the stored ones.
///
/// # Errors
/// One that is not in the firmware's table, or out of its range.
pub fn store(
    stored: &mut Params,
    parameters: impl IntoIterator<Item = (impl AsRef<str>, f32)>,
) -> Result<()> {
    for (name, value) in parameters {
        let name = name.as_ref();
        stored.set(name, value).map_err(|error| anyhow!("{name}: {error}"))?;
    }
    Ok(())
}

/// The rocket of a file, from the tables `[rocket]`, `[mounting]` and `[conditions]`.
fn rocket_of(
    file: &mut Table,
    name: &str,
    read: impl Fn(&str) -> Result<String>,
) -> Result<Airframe> {
    let motor = match file.get_mut("rocket") {
        Some(Value::Table(table)) => take_motor(table, read)?,
        _ => None,
    };
    let presets =
        [("SPICA", RocketParameters::SPICA), ("SPICA_UNSTABLE", RocketParameters::SPICA_UNSTABLE)];
    let rocket = section(file, "rocket", None, &presets)?;
    let rocket = RocketParameters { curve: motor.map(|motor| motor.curve), ..rocket };
    let mounting = Mounting { sensor_m: [0.0, 0.0, -rocket.dry_cm_m], ..Mounting::SPICA };
    let mounting = section(file, "mounting", Some(mounting), &[])?;
    let spica = [("SPICA", Conditions::SPICA)];
    let conditions = section(file, "conditions", Some(Conditions::CALM), &spica)?;
    let airframe = Airframe::new(name.to_owned(), rocket, mounting, conditions);
    airframe.map_err(|error| refused(error.to_string()))
}

/// Takes the motor out of a `[rocket]` and puts its thrust, burn and propellant in: `motor` names a
/// RASP file, which `read` reads; `thrust_curve` has points.
fn take_motor(table: &mut Table, read: impl Fn(&str) -> Result<String>) -> Result<Option<Motor>> {
    let motor = match (table.remove("motor"), table.remove("thrust_curve")) {
        (None, None) => return Ok(None),
        (Some(Value::String(path)), None) => {
            let (motor, propellant_kg) = Motor::parse_rasp(&read(&path)?)
                .map_err(|error| refused(format!("{path}: {error}")))?;
            table.entry("propellant_kg").or_insert(propellant_kg.into());
            motor
        }
        (None, Some(points)) => {
            let points: Vec<[f64; 2]> = points
                .try_into()
                .map_err(|_| refused("thrust_curve is a list of points [s, N]".into()))?;
            Motor::new(&points).map_err(|error| refused(error.to_string()))?
        }
        _ => return Err(refused("motor names a file, and thrust_curve stands alone".into())),
    };
    for (key, value) in [("thrust_n", motor.thrust_n), ("burn_s", motor.burn_s)] {
        if table.insert(key.to_owned(), value.into()).is_some() {
            let message = format!("{key} stands there, and a motor or thrust_curve gives it");
            return Err(refused(message));
        }
    }
    Ok(Some(motor))
}

fn refused(message: String) -> anyhow::Error {
    SetupError::Key { table: "rocket", message }.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vehicle> {
        let motor = |path: &str| match path {
            "a.eng" => Ok("A1 18 70 0 0.01 0.03 x\n0.5 10\n2 0".to_owned()),
            _ => bail!("{path} is not there"),
        };
        Vehicle::parse(text, "mine", setup(ServoKind::S3003), motor)
    }

    fn example(name: &str) -> Vehicle {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vehicles").join(name);
        VehicleChoice::File(path).read(ServoKind::S3003).unwrap()
    }

    #[test]
    fn a_choice_is_a_name_or_a_file() {
        assert_eq!("drone2".parse(), Ok(VehicleChoice::Known(VehicleKind::Drone2)));
        assert_eq!("a/b.toml".parse(), Ok(VehicleChoice::File("a/b.toml".into())));
        assert!("plane".parse::<VehicleChoice>().is_err());
    }

    #[test]
    fn the_examples_are_read_and_their_images_take_their_parameters() {
        let drone = example("drone.toml").setup.drone;
        assert!((drone.thrust_n - Parameters::PHYS.thrust_n).abs() < 0.02, "{}", drone.thrust_n);
        let hobby = &example("hobby_rocket.toml").airframes[0];
        assert_eq!((hobby.name.as_str(), hobby.rocket().burn_s), ("hobby_rocket", 3.0));
        let spica = &example("spica.toml").airframes[0];
        assert_eq!(spica.conditions, Conditions::SPICA);
        for airframe in [hobby, spica] {
            let parameters = rocket::parameters(airframe, RocketLaw::Scheduled);
            store(&mut Params::default(), parameters).unwrap();
        }
    }

    #[test]
    fn tables_say_what_kind_it_is() {
        let two = read("[two_axes]\nlateral_cm_m = \"2 mm\"").unwrap();
        assert_eq!((two.kind, two.two_axes.lateral_cm_m), (VehicleKind::Drone2, 0.002));
        let again = read(&two.to_toml()).unwrap();
        assert_eq!((again.kind, again.two_axes), (two.kind, two.two_axes));
        assert_eq!(read("[drone]\nthrust_n = 20").unwrap().kind, VehicleKind::Drone);
        let rocket = read("[rocket]\npreset = \"SPICA\"\nburn_s = 80").unwrap();
        assert_eq!(rocket.kind, VehicleKind::Rocket);
        assert_eq!(rocket.airframes[0].conditions, Conditions::CALM);
    }

    #[test]
    fn mistakes_are_named() {
        let spica = |more: &str| format!("[rocket]\npreset = \"SPICA\"\n{more}");
        let without = "[rocket]\nthrust_curve = [[0, 10], [1, 0]]\n".to_owned();
        for (text, why) in [
            ("[rocket]\ndrag = 0.4".to_owned(), "missing field"),
            (without, "missing field"),
            (spica("motor = \"a.eng\"\nthrust_n = 3"), "thrust_n stands there"),
            (spica("motor = \"b.eng\""), "b.eng is not there"),
            (spica("motor = 3"), "motor names a file"),
            (spica("thrust_curve = 3"), "list of points"),
            (spica("thrust_curve = [[0, 1]]"), "2 to 32 points"),
            (spica("burn = 3"), "unknown field"),
            (spica("drag = \"a lot\""), "expected f64"),
            (spica("burn_s = -3"), "burn_s is -3"),
            (spica("burn_s = 1e9"), "at most 600"),
            (spica("[mounting]\nshaft_per_gimbal = 0"), "shaft_per_gimbal is 0"),
            (spica("[conditions]\nwind_m_s = inf"), "steady_m_s"),
            (spica("[conditions]\nkick_rad_s = 9"), "kick_rad_s is 9"),
            (spica("[conditions]\nkicks_s = [1]"), "length"),
            (spica("[drone]"), "unknown table [drone]"),
            ("[two_axes]\nspin = 3".to_owned(), "spin"),
            ("[plane]".to_owned(), "unknown table [plane]"),
            ("# cut off".to_owned(), "no vehicle in it"),
        ] {
            let refused = format!("{:#}", read(&text).unwrap_err());
            assert!(refused.contains(why), "{text}: {refused}");
        }
    }
}
