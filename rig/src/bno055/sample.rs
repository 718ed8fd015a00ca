//! What the sensors measure at one refresh.

/// Standard gravity, m/s^2: the chip's 1 g.
pub(crate) const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// One refresh of the sensors, in SI units along the package axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sample {
    pub(super) acc_m_s2: [f64; 3],
    pub(super) gyr_rad_s: [f64; 3],
    pub(super) mag_ut: [f64; 3],
    pub(super) attitude: [f64; 4],
}
