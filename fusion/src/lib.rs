//! Attitude filters.
#![no_std]
