//! The image.

#![allow(
    dead_code,
    reason = "an image has one subject, and one that is only weighed does not set it up"
)]

#[cfg(feature = "ahrs")]
mod ahrs;
#[cfg(feature = "imu-fusion")]
mod imu_fusion;
mod subject;
mod tvc_fusion;
mod tvc_pid;
#[cfg(feature = "uf-ahrs")]
mod uf_ahrs;
#[cfg(feature = "vqf-rs")]
mod vqf_rs;

use core::arch::asm;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use subject::Subject;

/// Whose update it is: of a filter without a magnetometer or with one, or of something else.
macro_rules! subject {
    (
        $($six:literal $nine:literal: $($filter:ident)::+<$($of:ty)?>,)*
        $(=> $feature:literal: $subject:ty,)*
    ) => {
        $(
            #[cfg(feature = $six)]
            type Measured = $($filter)::+<$($of,)? false>;
            #[cfg(feature = $nine)]
            type Measured = $($filter)::+<$($of,)? true>;
        )*
        $(
            #[cfg(feature = $feature)]
            type Measured = $subject;
        )*
        #[cfg(not(any($(feature = $six, feature = $nine,)* $(feature = $feature),*)))]
        type Measured = subject::Nothing;
    };
}

subject! {
    "gyro-6d" "gyro-9d": tvc_fusion::Float<::tvc_fusion::Gyro>,
    "complementary-6d" "complementary-9d": tvc_fusion::Float<::tvc_fusion::Complementary>,
    "kalman-6d" "kalman-9d": tvc_fusion::Float<::tvc_fusion::Kalman>,
    "mahony-6d" "mahony-9d": tvc_fusion::Float<::tvc_fusion::Mahony>,
    "madgwick-6d" "madgwick-9d": tvc_fusion::Float<::tvc_fusion::Madgwick>,
    "vqf-6d" "vqf-9d": tvc_fusion::Float<::tvc_fusion::Vqf>,
    "fixed-complementary-6d" "fixed-complementary-9d": tvc_fusion::Fixed<::tvc_fusion::fixed::Complementary>,
    "fixed-madgwick-6d" "fixed-madgwick-9d": tvc_fusion::Fixed<::tvc_fusion::fixed::Madgwick>,
    "fixed-mahony-6d" "fixed-mahony-9d": tvc_fusion::Fixed<::tvc_fusion::fixed::Mahony>,
    "fixed-vqf-6d" "fixed-vqf-9d": tvc_fusion::Fixed<::tvc_fusion::fixed::Vqf>,
    "ahrs-mahony-6d" "ahrs-mahony-9d": ahrs::Filter<::ahrs::Mahony<f32>>,
    "ahrs-madgwick-6d" "ahrs-madgwick-9d": ahrs::Filter<::ahrs::Madgwick<f32>>,
    "imu-fusion-6d" "imu-fusion-9d": imu_fusion::Filter<>,
    "uf-ahrs-mahony-6d" "uf-ahrs-mahony-9d": uf_ahrs::Filter<::uf_ahrs::Mahony>,
    "uf-ahrs-madgwick-6d" "uf-ahrs-madgwick-9d": uf_ahrs::Filter<::uf_ahrs::Madgwick>,
    "uf-ahrs-vqf-6d" "uf-ahrs-vqf-9d": uf_ahrs::Filter<::uf_ahrs::Vqf>,
    "vqf-rs-6d" "vqf-rs-9d": vqf_rs::Filter<>,
    => "roll-pitch-yaw-9d": tvc_fusion::FloatAngles,
    => "fixed-roll-pitch-yaw-9d": tvc_fusion::FixedAngles,
    => "law-pd": tvc_pid::Control<::tvc_pid::Pd<f32>>,
    => "law-fixed-pd": tvc_pid::Control<::tvc_pid::Pd<::tvc_pid::Q16>>,
    => "law-pid": tvc_pid::Control<::tvc_pid::Controller<f32, ::tvc_pid::Pid<f32>>>,
    => "law-fixed-pid": tvc_pid::Control<::tvc_pid::Controller<::tvc_pid::Q16, ::tvc_pid::Pid<::tvc_pid::Q16>>>,
    => "law-surface": tvc_pid::Control<::tvc_pid::Controller<f32, ::tvc_pid::Surface<f32>>>,
    => "law-fixed-surface": tvc_pid::Control<::tvc_pid::Controller<::tvc_pid::Q16, ::tvc_pid::Surface<::tvc_pid::Q16>>>,
}

type Input = <Measured as Subject>::Input;
type Output = <Measured as Subject>::Output;

/// Words of the largest input. All images have this many, so that the state is what their RAM
/// differs by.
const INPUT_WORDS: usize = 10;
const _: () = assert!(size_of::<Input>() <= 4 * INPUT_WORDS);

/// What the next update is given.
#[unsafe(no_mangle)]
static mut INPUT: [u32; INPUT_WORDS] = [0; INPUT_WORDS];

/// Where the filter takes up to be, in the body's axes.
#[cfg(feature = "setup")]
#[unsafe(no_mangle)]
static mut UP: [f32; 3] = [0.0; 3];

static mut STATE: MaybeUninit<Measured> = MaybeUninit::uninit();

/// The update that is measured. Its address is taken, so it stays a function of its own that knows
/// nothing of the state. By the C calling convention an output of a word is returned in R0.
extern "C" fn update(state: &mut Measured, input: &Input) -> Output {
    state.update(input)
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let state = (&raw mut STATE).cast::<Measured>();
    let input = (&raw mut INPUT).cast::<Input>();
    // SAFETY: nothing else uses the static, and it has room for the state.
    #[cfg(feature = "setup")]
    unsafe {
        state.write(Measured::new());
    }
    loop {
        // SAFETY: `update` follows the C calling convention, and all that it may change is given
        // up. Its arguments are two statics that nothing else uses meanwhile: a state that was made
        // above (an image without one is not run), and an input that any bits make valid.
        unsafe {
            asm!(
                "bkpt #0",
                "bl {update}",
                "bkpt #1",
                update = sym update,
                inout("r0") state => _,
                inout("r1") input => _,
                clobber_abi("C"),
            );
        }
        #[cfg(feature = "setup")]
        // SAFETY: the update is over, and whoever reads `UP` does so at the breakpoint.
        unsafe {
            UP = (*state).up();
            asm!("bkpt #2");
        }
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {
        // SAFETY: stops whoever runs the image; touches nothing.
        unsafe { asm!("bkpt #3") }
    }
}
