//! Controllers.
#![no_std]
