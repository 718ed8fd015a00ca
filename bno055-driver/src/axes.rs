//! Axis maps: rotations by right angles between the chip and its outputs.

/// A sensor axis as printed on the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Axis {
    /// The chip's x.
    X = 0,
    /// The chip's y.
    Y = 1,
    /// The chip's z.
    Z = 2,
}

/// The chip's axis, and its sense, that an output axis shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Signed {
    /// The chip's axis.
    pub axis: Axis,
    /// Whether the output shows the opposite direction.
    pub negative: bool,
}

impl Signed {
    /// Along the chip's axis.
    pub const fn plus(axis: Axis) -> Self {
        Self { axis, negative: false }
    }

    /// Against the chip's axis.
    pub const fn minus(axis: Axis) -> Self {
        Self { axis, negative: true }
    }
}

/// The reason why three axes make no axis map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AxisMapError {
    /// Two outputs show the same axis: the chip would silently ignore the map.
    Repeated,
    /// The map turns a right-handed frame into a left-handed frame, in which rates have the wrong
    /// sign.
    Mirrored,
}

impl core::fmt::Display for AxisMapError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Repeated => "axis map shows an axis twice",
            Self::Mirrored => "axis map is left-handed",
        })
    }
}

impl core::error::Error for AxisMapError {}

/// A rotation by right angles between the chip's frame and its outputs (data sheet section 3.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AxisMap {
    config: u8,
    sign: u8,
}

impl AxisMap {
    /// Placements P0 to P7 of the data sheet; P1 is the chip's default.
    pub const PLACEMENTS: [Self; 8] = [
        Self::from_registers(0x21, 0x04),
        Self::IDENTITY,
        Self::from_registers(0x24, 0x06),
        Self::from_registers(0x21, 0x02),
        Self::from_registers(0x24, 0x03),
        Self::from_registers(0x21, 0x01),
        Self::from_registers(0x21, 0x07),
        Self::from_registers(0x24, 0x05),
    ];

    /// Outputs as printed on the chip (P1, the default).
    pub const IDENTITY: Self = Self::from_registers(0x24, 0x00);

    const fn from_registers(config: u8, sign: u8) -> Self {
        Self { config, sign }
    }

    /// The map that shows `x`, `y` and `z` on the output axes of these names.
    ///
    /// # Errors
    /// An axis shown twice, or a left-handed frame.
    pub const fn new(x: Signed, y: Signed, z: Signed) -> Result<Self, AxisMapError> {
        let (i, j, k) = (x.axis as u8, y.axis as u8, z.axis as u8);
        if i == j || j == k || k == i {
            return Err(AxisMapError::Repeated);
        }
        // x y z, y z x and z x y are rotations, the other orders mirror; so does each sign.
        let even = (j + 3 - i) % 3 == 1;
        let mirrored = !even ^ x.negative ^ y.negative ^ z.negative;
        if mirrored {
            return Err(AxisMapError::Mirrored);
        }
        Ok(Self {
            config: k << 4 | j << 2 | i,
            sign: (x.negative as u8) << 2 | (y.negative as u8) << 1 | z.negative as u8,
        })
    }

    /// AXIS_MAP_CONFIG and AXIS_MAP_SIGN.
    pub const fn registers(&self) -> [u8; 2] {
        [self.config, self.sign]
    }
}

impl Default for AxisMap {
    fn default() -> Self {
        Self::IDENTITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// The matrix that a pair of registers stands for.
    fn matrix([config, sign]: [u8; 2]) -> [[i32; 3]; 3] {
        let mut matrix = [[0; 3]; 3];
        for (output, row) in matrix.iter_mut().enumerate() {
            let negative = sign >> (2 - output) & 1 != 0;
            row[usize::from(config >> (2 * output) & 3)] = if negative { -1 } else { 1 };
        }
        matrix
    }

    fn determinant(m: [[i32; 3]; 3]) -> i32 {
        (0..3)
            .map(|i| {
                m[0][i]
                    * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3]
                        - m[1][(i + 2) % 3] * m[2][(i + 1) % 3])
            })
            .sum()
    }

    /// All 216 candidates: exactly the 24 rotations of a cube are maps.
    #[test]
    fn the_rotations_of_a_cube_and_nothing_else() {
        let (mut maps, mut repeated, mut mirrored) = (0, 0, 0);
        for (x, y, z) in AXES
            .iter()
            .flat_map(|x| AXES.iter().flat_map(move |y| AXES.iter().map(move |z| (*x, *y, *z))))
        {
            for signs in 0..8_u8 {
                let signed = |axis, bit: u8| Signed { axis, negative: signs >> bit & 1 != 0 };
                match AxisMap::new(signed(x, 2), signed(y, 1), signed(z, 0)) {
                    Ok(map) => {
                        maps += 1;
                        assert_eq!(determinant(matrix(map.registers())), 1);
                        assert_eq!(
                            map.registers(),
                            [(z as u8) << 4 | (y as u8) << 2 | x as u8, signs]
                        );
                    }
                    Err(AxisMapError::Repeated) => {
                        repeated += 1;
                        assert!(x == y || y == z || z == x);
                    }
                    Err(AxisMapError::Mirrored) => {
                        mirrored += 1;
                        assert_eq!(
                            determinant(matrix([(z as u8) << 4 | (y as u8) << 2 | x as u8, signs])),
                            -1
                        );
                    }
                }
            }
        }
        assert_eq!((maps, repeated, mirrored), (24, 168, 24));
    }

    #[test]
    fn the_data_sheets_placements_are_rotations() {
        for placement in AxisMap::PLACEMENTS {
            assert_eq!(determinant(matrix(placement.registers())), 1);
        }
        assert_eq!(AxisMap::default().registers(), [0x24, 0x00]);
    }
}
