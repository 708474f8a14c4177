//! The published camera branch at 256 x 704, one sample: forward and training step, the backbone alone and all.
//!
//! `cargo bench --bench camera_branch -- branch_train --sample-count 3`; run one bench alone for its peak
//! memory, which is printed at the end.

use burn::tensor::{Device, Distribution, Tensor};
use harmzone::geometry::{Pinhole, Transform};
use harmzone::model::{
    CameraBackbone, CameraConfig, CameraGeometry, NetworkImage, Swin, SwinCameraBatch, SwinCameraBranch,
    SwinCameraConfig, SwinCameraInput, SwinConfig,
};
use image::RgbImage;
use nalgebra::Vector3;

fn main() {
    divan::main();
    let status = fs_err::read_to_string("/proc/self/status").unwrap_or_default();
    if let Some(peak) = status.lines().find(|line| line.starts_with("VmHWM")) {
        println!("peak memory of the process: {peak}");
    }
}

/// A grey image and a wall of LiDAR points, as the car's sensors are mounted.
fn batch(config: &SwinCameraConfig, device: &Device) -> SwinCameraBatch {
    let full = CameraGeometry {
        intrinsics: Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians()),
        ego_from_camera: Transform::looking_forward(Vector3::new(1.7, 0.0, 1.5), 0.0),
    };
    let image = RgbImage::from_fn(800, 450, |x, y| image::Rgb([(x % 256) as u8, (y % 256) as u8, 90]));
    let camera_config =
        CameraConfig { backbone: CameraBackbone::Swin, swin: *config, ..CameraConfig::default() };
    let image = NetworkImage::resize(&image, &camera_config).expect("the image is high enough");
    let point = |i| [5.0 + f64::from(i % 200) * 0.25, f64::from(i / 200) * 0.5 - 25.0, 0.5, 0.0];
    let points: Vec<[f64; 4]> = (0..20_000).map(point).collect();
    let input = SwinCameraInput::prepare(&image, &image.view(&full), &points);
    SwinCameraBatch::stack(&[&input], config, device)
}

#[divan::bench]
fn prepare(bencher: divan::Bencher) {
    bencher.bench_local(|| batch(&SwinCameraConfig::default(), &Device::flex()));
}

#[divan::bench]
fn swin_forward(bencher: divan::Bencher) {
    let device = Device::flex();
    let swin = Swin::init(&SwinConfig::default(), &device);
    let image = Tensor::<4>::random([1, 3, 256, 704], Distribution::Default, &device);
    bencher.bench_local(|| swin.forward(image.clone()));
}

#[divan::bench]
fn swin_train(bencher: divan::Bencher) {
    let device = Device::flex().autodiff();
    let swin = Swin::init(&SwinConfig { drop_path: 0.0, ..SwinConfig::default() }, &device);
    let image = Tensor::<4>::random([1, 3, 256, 704], Distribution::Default, &device);
    bencher.bench_local(|| {
        let sums = swin.forward(image.clone()).map(|map| map.powf_scalar(2.0).sum());
        sums.into_iter().reduce(|a, b| a + b).expect("three maps").backward()
    });
}

#[divan::bench]
fn branch_forward(bencher: divan::Bencher) {
    let device = Device::flex();
    let config = SwinCameraConfig::default();
    let (branch, batch) = (SwinCameraBranch::init(&config, &device), batch(&config, &device));
    bencher.bench_local(|| branch.forward(&batch));
}

#[divan::bench]
fn branch_train(bencher: divan::Bencher) {
    let device = Device::flex().autodiff();
    let mut config = SwinCameraConfig::default();
    config.swin.drop_path = 0.0;
    let (branch, batch) = (SwinCameraBranch::init(&config, &device), batch(&config, &device));
    bencher.bench_local(|| branch.forward(&batch).powf_scalar(2.0).mean().backward());
}
