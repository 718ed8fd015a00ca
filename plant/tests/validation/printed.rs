//! The thesis' printed equations where they go wrong, beside the right terms of the model.

use plant::{Mechanism, Parameters};

/// A term as printed and as it should be.
#[derive(Debug)]
struct Deviation {
    printed: f64,
    right: f64,
}

/// Right-hand side of the printed rows 13 and 14 of (5.30): the signs of the constraint's
/// centripetal terms are `+,+,+` and `-,+,+` instead of `-,-,+` and `+,-,-`.
fn printed_centripetal(p: &Parameters, angles: [f64; 3], rates: [f64; 3]) -> [f64; 2] {
    let [(s1, c1), (s2, c2), (s3, c3)] = angles.map(f64::sin_cos);
    let [v1, v2, v3] = rates.map(|v| v * v);
    let (l1, l2, l3) = (p.crank_length_m, p.link_length_m, p.arm_length_m);
    [l1 * s1 * v1 + l2 * c2 * v2 + l3 * s3 * v3, -l1 * c1 * v1 + l2 * s2 * v2 + l3 * c3 * v3]
}

/// The deviations that have a number of their own, for the recommended drone.
fn deviations(mechanism: &Mechanism) -> Vec<Deviation> {
    let p = mechanism.parameters();
    let [servo_x, drop] = p.servo_axis_m();
    let drop = drop.abs();

    // A crank at 0.5 rad turning evenly at 5 rad/s.
    let (crank, rate) = (0.5, 5.0);
    let at = mechanism.linkage().at(crank);
    let angles = [crank, at.link_rad(), at.rudder_rad()];
    let rates = [rate, at.link_ratio * rate, at.rudder_ratio * rate];
    let slave = |gamma: [f64; 2]| {
        let ((s2, c2), det) =
            (at.link_rad().sin_cos(), p.arm_length_m * (at.link_rad() - at.rudder_rad()).cos());
        (c2 * gamma[0] + s2 * gamma[1]) / det
    };

    let still = mechanism.configuration(mechanism.linkage().zero_rudder_crank_rad());
    vec![
        // Gravity does not turn with the drone, upright: N m, with the horn's 50 g of the table.
        Deviation {
            printed: Parameters::THESIS_TABLE.crank_mass_kg
                * Parameters::THESIS_TABLE.gravity_m_s2
                * servo_x,
            right: p.gravity_m_s2 * still.first_moment[0],
        },
        // The wash's force is multiplied by its lever in a force row: N m for a radian of rudder.
        Deviation { printed: drop * drop * p.thrust_n, right: drop * p.thrust_n },
        // Signs of the constraint's centripetal terms: rudder acceleration, rad/s2.
        Deviation {
            printed: slave(printed_centripetal(p, angles, rates)),
            right: at.rudder_curvature * rate * rate,
        },
    ]
}

#[test]
fn deviations_have_the_reference_sizes() {
    let mechanism = Mechanism::new(&Parameters::PHYS).unwrap();
    let found = deviations(&mechanism);
    for (deviation, printed, right, digit) in [
        (&found[0], 0.038, 0.0, 5e-4),
        (&found[1], 1.14, 5.85, 5e-3),
        (&found[2], 10.9, -7.57, 5e-2),
    ] {
        assert!((deviation.printed - printed).abs() < digit, "{deviation:?}");
        assert!((deviation.right - right).abs() < digit, "{deviation:?}");
    }
    assert!((found[1].right / found[1].printed - 5.1).abs() < 0.05);
    // 0.038 N m on 0.1 + 0.0205 + 0.0022 kg m2 of body and rudder: the artefact of figure 5.12.
    assert!((found[0].printed / 0.1227 - 0.31).abs() < 0.005);
}
