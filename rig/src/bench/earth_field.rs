//! Earth's magnetic field on the bench.

/// Earth's magnetic field where the rig stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// Strength, uT.
    pub strength_ut: f64,
    /// Angle below the horizon, rad.
    pub dip_rad: f64,
    /// Magnetic north from true north, east positive, rad.
    pub declination_rad: f64,
}

impl EarthField {
    /// Copenhagen: 50 uT, 70 deg down, 4.37 deg east.
    pub const COPENHAGEN: Self = Self {
        strength_ut: 50.0,
        dip_rad: 70.0 * std::f64::consts::PI / 180.0,
        declination_rad: 4.37 * std::f64::consts::PI / 180.0,
    };

    /// The field to north, east and down, uT.
    pub fn north_east_down(&self) -> [f64; 3] {
        let (sin_dip, cos_dip) = self.dip_rad.sin_cos();
        let (sin_decl, cos_decl) = self.declination_rad.sin_cos();
        [cos_dip * cos_decl, cos_dip * sin_decl, sin_dip].map(|c| c * self.strength_ut)
    }
}
