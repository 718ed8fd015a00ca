//! Magnetic declination of a place and a day, by the world magnetic model.

use anyhow::{Context, Result};
use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::{Date, OffsetDateTime};
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;

use super::options::{Calibrate, Place};
use report::exit::BadInput;

/// The declination that the command line asks for, deg, if it asks for one.
///
/// # Errors
/// As [`declination_deg`].
pub fn asked_deg(options: &Calibrate) -> Result<Option<f64>> {
    // A place may come from the configuration.
    match (options.declination, options.place) {
        (None, Some(place)) => declination_deg(place, options.date).map(Some),
        (declination, _) => Ok(declination),
    }
}

fn today() -> Result<Date> {
    let since = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .context("the clock of this computer")?;
    Ok(OffsetDateTime::from_unix_timestamp(since.as_secs() as i64)?.date())
}

/// Declination at sea level, deg, east positive; `None` is today.
///
/// # Errors
/// [`BadInput`] for a day that the calendar does not have, or one outside of the model's years.
pub fn declination_deg(place: Place, day: Option<Date>) -> Result<f64> {
    let date = day.map_or_else(today, Ok)?;
    let field = GeomagneticField::new(
        Length::new::<meter>(0.0),
        Angle::new::<degree>(place.latitude_deg),
        Angle::new::<degree>(place.longitude_deg),
        date,
    )
    .map_err(|error| BadInput::new(format!("no declination for this place and date: {error}")))?;
    Ok(f64::from(field.declination().get::<degree>()))
}

#[cfg(test)]
mod tests {
    use world_magnetic_model::time::Month;

    use super::*;

    #[test]
    fn declination_of_copenhagen_as_the_model_has_it() {
        let place = Place { latitude_deg: 55.79, longitude_deg: 12.52 };
        let of = |year| {
            let day = Date::from_calendar_date(year, Month::July, 1).unwrap();
            declination_deg(place, Some(day))
        };
        let deg = of(2026).unwrap();
        assert!((4.3..6.0).contains(&deg), "{deg}");
        assert!(of(1900).is_err());
    }
}
