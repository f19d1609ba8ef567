#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| nunet_fuzz::ros2::live_message(data));
