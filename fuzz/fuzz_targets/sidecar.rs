#![no_main]

harmzone_fuzz::fuzz!("sidecar");
