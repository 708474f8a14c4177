//! The voxel branch at its published size on the cloud of one front sector: each stage by itself.
//!
//! The cloud is made by formula: ground rings of a 32-beam LiDAR and walls, ten sweeps of it moved forward,
//! so that it fills as many voxels as `N_SWEEPS` asks for.

use std::hint::black_box;

use burn::tensor::{Device, Tensor};
use harmzone::model::{
    BevBackbone, LidarVoxelConfig, N_VOXEL_FEATURES, SparseEncoder, VoxelBatch, Voxels, voxelize,
};

/// Sweeps laid over each other: one as our samples have, and many for the limits of memory.
const N_SWEEPS: [usize; 2] = [1, 10];

fn main() {
    divan::main();
}

/// Points in the ego frame: x, y, z, intensity.
fn cloud(n_sweeps: usize) -> Vec<[f64; 4]> {
    let mut points = Vec::new();
    for sweep in 0..n_sweeps {
        for beam in 0..32 {
            let elevation_rad = (-30.0 + 1.3 * f64::from(beam)).to_radians();
            for step in 0..2000 {
                let azimuth_rad = (f64::from(step) * 0.06 - 60.0).to_radians() + 0.0003 * sweep as f64;
                // A street 16 m wide, and ground 1.84 m under the sensor.
                let to_wall_m = 8.0 / azimuth_rad.sin().abs().max(0.15) / elevation_rad.cos();
                let to_ground_m =
                    if elevation_rad < 0.0 { 1.84 / -elevation_rad.sin() } else { f64::INFINITY };
                let range_m = to_wall_m.min(to_ground_m);
                let flat_m = range_m * elevation_rad.cos();
                let x_m = flat_m * azimuth_rad.cos() + 0.9 - 0.5 * sweep as f64;
                let y_m = flat_m * azimuth_rad.sin();
                points.push([x_m, y_m, range_m * elevation_rad.sin() + 1.84, f64::from(step % 256)]);
            }
        }
    }
    points
}

fn voxels(n_sweeps: usize, config: &LidarVoxelConfig) -> Voxels {
    voxelize(&cloud(n_sweeps), &config.voxels)
}

#[divan::bench(args = N_SWEEPS, sample_count = 10, sample_size = 1)]
fn voxelization(bencher: divan::Bencher, n_sweeps: usize) {
    let (points, config) = (cloud(n_sweeps), LidarVoxelConfig::default());
    bencher.bench_local(|| voxelize(&points, &config.voxels));
}

#[divan::bench(args = N_SWEEPS, sample_count = 10, sample_size = 1)]
fn rulebooks(bencher: divan::Bencher, n_sweeps: usize) {
    let (config, device) = (LidarVoxelConfig::default(), Device::flex());
    let voxels = voxels(n_sweeps, &config);
    bencher.bench_local(|| VoxelBatch::stack(&[&voxels], &config, &device));
}

struct Net {
    encoder: SparseEncoder,
    backbone: BevBackbone,
}

impl Net {
    fn init(config: &LidarVoxelConfig, device: &Device) -> Self {
        let [n_channels, ..] = config.encoded_shape();
        Self {
            encoder: SparseEncoder::init(N_VOXEL_FEATURES, &config.encoder, device),
            backbone: BevBackbone::init(n_channels, &config.backbone, device),
        }
    }

    fn encode(&self, batch: &VoxelBatch) -> Tensor<4> {
        self.encoder.forward(batch.features.clone(), &batch.rulebooks, 1)
    }

    fn run_all(&self, batch: &VoxelBatch) -> Tensor<4> {
        self.backbone.forward(self.encode(batch))
    }
}

fn forward(bencher: divan::Bencher, n_sweeps: usize, run: fn(&Net, &VoxelBatch) -> Tensor<4>) {
    let (config, device) = (LidarVoxelConfig::default(), Device::flex());
    let net = Net::init(&config, &device);
    let batch = VoxelBatch::stack(&[&voxels(n_sweeps, &config)], &config, &device);
    bencher.bench_local(|| black_box(run(&net, &batch)));
}

fn train(bencher: divan::Bencher, n_sweeps: usize, run: fn(&Net, &VoxelBatch) -> Tensor<4>) {
    let (config, device) = (LidarVoxelConfig::default(), Device::flex().autodiff());
    let net = Net::init(&config, &device);
    let batch = VoxelBatch::stack(&[&voxels(n_sweeps, &config)], &config, &device);
    bencher.bench_local(|| black_box(run(&net, &batch).sum().backward()));
}

#[divan::bench(args = N_SWEEPS, sample_count = 5, sample_size = 1)]
fn encoder_forward(bencher: divan::Bencher, n_sweeps: usize) {
    forward(bencher, n_sweeps, Net::encode);
}

#[divan::bench(args = N_SWEEPS, sample_count = 5, sample_size = 1)]
fn encoder_train(bencher: divan::Bencher, n_sweeps: usize) {
    train(bencher, n_sweeps, Net::encode);
}

#[divan::bench(args = [1], sample_count = 3, sample_size = 1)]
fn branch_forward(bencher: divan::Bencher, n_sweeps: usize) {
    forward(bencher, n_sweeps, Net::run_all);
}

#[divan::bench(args = [1], sample_count = 3, sample_size = 1)]
fn branch_train(bencher: divan::Bencher, n_sweeps: usize) {
    train(bencher, n_sweeps, Net::run_all);
}
