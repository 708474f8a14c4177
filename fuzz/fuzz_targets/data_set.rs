#![no_main]

harmzone_fuzz::fuzz!("data_set");
