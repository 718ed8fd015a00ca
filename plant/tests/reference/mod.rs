//! The servos of the reference: stiff, with a lag that no load changes.

use plant::ServoModel;

/// Of the S3003's class: 10 ms at zero rudder.
pub(crate) const S3003: ServoModel = ServoModel { droop: 0.0, ..ServoModel::S3003 };

/// The fast digital one: 6 ms, for which 0.8 N m are too little.
pub(crate) const DIGITAL: ServoModel =
    ServoModel { droop: 0.0, stall_n_m: 1.0, rotor_kg_m2: 1.45e-5, ..ServoModel::DIGITAL };
