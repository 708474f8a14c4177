#![no_main]

harmzone_fuzz::fuzz!("import_ros2");
