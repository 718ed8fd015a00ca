//! Configurations and states as text.

use nalgebra::Vector3;
use tvc_fusion::{Config, Estimator, GRAVITY, Sample, State, Vqf, VqfGains};

#[test]
fn a_state_comes_back_to_the_bit() {
    let mut estimator = Estimator::<Vqf>::new(&Config::default()).expect("valid");
    for _ in 0..1_000 {
        estimator.update(
            0.01,
            &Sample {
                gyr: Vector3::new(0.01, -0.02, 0.03).into(),
                acc: Vector3::new(0.3, -0.2, -GRAVITY).into(),
                mag: Some(Vector3::new(17.0, 3.0, 47.0).into()),
            },
        );
    }
    let state = estimator.state();
    assert!(state.bias.is_some() && state.field.is_some());
    let text = serde_json::to_string(&state).expect("finite");
    assert_eq!(serde_json::from_str::<State>(&text).expect("just written"), state);
}

#[test]
fn a_configuration_may_name_what_differs_only() {
    let text = r#"{ "gains": { "mag_tau_s": 12.0 }, "rest": { "time_s": 2.0 }, "gap_s": 0.5 }"#;
    let config: Config<VqfGains> = serde_json::from_str(text).expect("known names");
    let mut expected = Config::<VqfGains>::default();
    expected.gains.mag_tau_s = 12.0;
    expected.rest.time_s = 2.0;
    expected.gap_s = 0.5;
    assert_eq!(config, expected);
}
