#![no_main]

harmzone_fuzz::fuzz!("image_weights");
