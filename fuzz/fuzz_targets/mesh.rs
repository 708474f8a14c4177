#![no_main]

harmzone_fuzz::fuzz!("mesh");
