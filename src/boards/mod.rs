//! The boards: what each of them leads to which pin of its chip. A feature chooses another one than
//! the Nano 33 IoT.

#[cfg(all(feature = "xiao-m0", feature = "qt-py-m0"))]
compile_error!("an image is for one board: choose xiao-m0 or qt-py-m0");

#[cfg_attr(feature = "xiao-m0", path = "xiao_m0.rs")]
#[cfg_attr(feature = "qt-py-m0", path = "qt_py_m0.rs")]
#[cfg_attr(not(any(feature = "xiao-m0", feature = "qt-py-m0")), path = "nano33iot.rs")]
mod chosen;

pub(crate) use chosen::WIRING;
