//! The picture of a made-up street, cast ray by ray.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::geometry::{Camera, Lidar, Pinhole, Point, Transform};
use crate::object::{Distribution, Event, Kind, Object};
use crate::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured, Truth};

fn object(category: &str, ood: bool, at: [f64; 2], size: [f64; 3], yaw_rad: f64) -> Object {
    Object {
        id: Some(format!("{category}-{}", at[0])),
        category: Some(category.to_owned()),
        kind: Some(Kind::Static),
        distribution: Some(if ood { Distribution::Ood } else { Distribution::Id }),
        box_in_ego: Box3 {
            center: Point::new(at[0], at[1], size[2] / 2.0),
            length_m: size[0],
            width_m: size[1],
            height_m: size[2],
            yaw_rad,
        },
        velocity_in_ego_mps: [0.0, 0.0],
        n_lidar_points: Some(10),
        visible_px: Some(100),
        visible_fraction: Some(1.0),
        event: Some(Event::None),
        solid: None,
        clearance_m: None,
        spot: None,
        is_tipped: None,
    }
}

/// First hit of a ray with the ground (index none) or an object: range and what was hit.
fn cast(origin: Point3<f64>, direction: Vector3<f64>, objects: &[Object]) -> Option<(f64, Option<usize>)> {
    let ground = (direction.z < 0.0).then(|| (-origin.z / direction.z, None));
    let boxes = objects.iter().enumerate().filter_map(|(i, object)| {
        let place = object.box_in_ego;
        let (sin, cos) = place.yaw_rad.sin_cos();
        let turn = |v: Vector3<f64>| Vector3::new(v.x * cos + v.y * sin, -v.x * sin + v.y * cos, v.z);
        let (from, along) = (turn(origin - place.center.coords), turn(direction));
        let half = Vector3::new(place.length_m, place.width_m, place.height_m) / 2.0;
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) = ((-half[axis] - from[axis]) / along[axis], (half[axis] - from[axis]) / along[axis]);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near < far).then_some((near, Some(i)))
    });
    boxes.chain(ground).min_by(|a, b| a.0.total_cmp(&b.0))
}

fn street() -> Sample {
    let mut objects = vec![
        object("hay_bale", true, [14.0, 0.9], [1.3, 1.1, 1.1], 0.5),
        object("barrel", true, [20.0, -2.9], [0.6, 0.6, 0.9], 0.0),
        object("car", false, [23.0, 1.6], [4.4, 1.8, 1.5], 0.05),
        object("pedestrian", false, [12.5, -3.4], [0.5, 0.6, 1.75], 1.2),
        object("lamp", false, [18.0, 5.2], [0.3, 0.3, 5.0], 0.0),
        object("car", false, [9.0, 4.4], [4.2, 1.8, 1.5], 0.0),
        object("van", false, [34.0, -6.5], [5.5, 2.0, 2.4], 1.5),
        object("container", true, [40.0, 7.0], [3.0, 1.8, 1.6], 0.1),
    ];
    let n_annotated = objects.len();
    for x in [12.0, 30.0, 48.0] {
        objects.push(object("house", false, [x, 14.0], [16.0, 10.0, 9.0], 0.0));
        objects.push(object("house", false, [x + 4.0, -15.0], [15.0, 10.0, 7.0], 0.0));
    }
    let ego_from_camera = Transform::<Ego, Camera>::looking_forward(Vector3::new(1.5, 0.0, 1.6), 0.03);
    let ego_from_lidar = Transform::<Ego, Lidar>::from_xyz_yaw(0.9, 0.0, 1.84, 0.0);
    let intrinsics = Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians());
    let eye = ego_from_camera.isometry.translation.vector.into();
    let picture = image::RgbImage::from_fn(800, 450, |u, v| {
        let ray = Vector3::new(
            (f64::from(u) + 0.5 - intrinsics.cx_px) / intrinsics.fx_px,
            (f64::from(v) + 0.5 - intrinsics.cy_px) / intrinsics.fy_px,
            1.0,
        );
        let base = match cast(eye, ego_from_camera.rotate(&ray), &objects) {
            None => [150, 180, 205],
            Some((_, None)) => [104, 104, 106],
            Some((range, Some(i))) if i >= n_annotated => {
                [170 - range as u8, 158 - range as u8, 140 - range as u8]
            }
            Some((_, Some(i))) => [[176, 140, 66], [60, 90, 130], [196, 196, 200], [90, 80, 120]][i % 4],
        };
        image::Rgb(base)
    });
    let mut bytes = Vec::new();
    picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    let mut points = Vec::new();
    for ring in 0..32u16 {
        for step in -106..=106 {
            let (sin_e, cos_e) = (-30.67 + 1.333 * f64::from(ring)).to_radians().sin_cos();
            let (sin_a, cos_a) = (f64::from(step) * 0.33).to_radians().sin_cos();
            let direction = Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
            let Some((range, _)) = cast(Point3::new(0.9, 0.0, 1.84), direction, &objects) else { continue };
            if range < 70.0 {
                let hit = direction * range;
                let [x_m, y_m, z_m] = [hit.x as f32, hit.y as f32, hit.z as f32];
                points.push(LidarPoint { x_m, y_m, z_m, intensity: 60.0, ring });
            }
        }
    }
    objects.truncate(n_annotated);
    Sample {
        measured: Measured {
            time_ns: 0,
            ego_state: EgoState {
                speed_mps: 8.0,
                steering_angle_rad: 0.06,
                yaw_rate_rps: 0.0,
                acceleration_mps2: 0.0,
                wheelbase_m: 2.7,
                front_bumper_x_m: 3.6,
            },
            world_from_ego: Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0),
            ego_from_lidar,
            ego_from_camera,
            intrinsics,
            image: EncodedImage { format: ImageFormat::Png, bytes },
            points,
        },
        truth: Some(Truth { objects, ..Truth::default() }),
    }
}

/// The zone of 8 m/s, near right corner first: 3.6 to 24.6 m, a lane wide.
const ZONE: [Point2; 4] = [
    Point2 { x_m: 3.6, y_m: -1.75 },
    Point2 { x_m: 24.6, y_m: -1.75 },
    Point2 { x_m: 24.6, y_m: 1.75 },
    Point2 { x_m: 3.6, y_m: 1.75 },
];

fn harms() -> Vec<Harm> {
    [true, false, true, false, false, false, false, false]
        .map(|is_harmful| if is_harmful { Harm::Harmful } else { Harm::Harmless })
        .to_vec()
}

fn scene(sample: &Sample) -> Scene<'_> {
    Scene {
        episode: "oldtown-ClearNoon-7",
        sample_idx: 12,
        sample,
        harms: None,
        zone: None,
        detections: None,
    }
}

/// Draws, and keeps the picture in the folder `HARMZONE_KEEP_PICTURES`, for inspection.
fn drawn(scene: &Scene, name: &str) -> RgbImage {
    let picture = draw(scene).unwrap();
    if let Some(folder) = std::env::var_os("HARMZONE_KEEP_PICTURES") {
        picture.save(std::path::Path::new(&folder).join(name)).unwrap();
    }
    picture
}

fn n_pixels_near(picture: &RgbImage, color: canvas::Color) -> usize {
    let is_near = |pixel: &&image::Rgb<u8>| {
        pixel.0.iter().zip(color.rgb).all(|(&a, b)| (i32::from(a) - i32::from(b)).abs() < 12)
    };
    picture.pixels().filter(is_near).count()
}

#[test]
fn a_labelled_sample_shows_its_zone_and_both_classes() {
    let sample = street();
    let harms = harms();
    let bare = drawn(&scene(&sample), "bare.png");
    let labelled = drawn(&Scene { harms: Some(&harms), zone: Some(&ZONE), ..scene(&sample) }, "labelled.png");
    assert_eq!(labelled.dimensions(), SIZE_PX);
    for color in [palette::ZONE, palette::truth(Harm::Harmful), palette::truth(Harm::Harmless)] {
        assert!(n_pixels_near(&bare, color) < 20, "{color:?} without labels");
        assert!(n_pixels_near(&labelled, color) > 200, "{color:?} with labels");
    }
}

#[test]
fn predictions_are_drawn_in_tones_of_their_own() {
    let sample = street();
    let harms = harms();
    let detections: Vec<Detection> = sample
        .objects()
        .iter()
        .zip(&harms)
        .enumerate()
        .map(|(i, (object, &harm))| {
            let mut box_in_ego = object.box_in_ego;
            box_in_ego.center =
                Point::new(box_in_ego.center.x() + 0.3, box_in_ego.center.y() - 0.15, box_in_ego.center.z());
            Detection {
                box_in_ego,
                velocity_in_ego_mps: [0.0, 0.0],
                harm,
                score: 0.95 - 0.07 * i as f64,
                spread: None,
            }
        })
        .collect();
    let labelled = Scene { harms: Some(&harms), zone: Some(&ZONE), ..scene(&sample) };
    let without = drawn(&labelled, "labelled.png");
    let with = drawn(&Scene { detections: Some(&detections), ..labelled }, "predicted.png");
    for harm in Harm::ALL {
        let color = palette::predicted(harm);
        assert!(n_pixels_near(&with, color) > n_pixels_near(&without, color) + 200, "{harm:?}");
    }
}

#[test]
fn a_zone_behind_the_camera_is_not_drawn_on_its_picture() {
    let sample = street();
    let behind = ZONE.map(|corner| Point2 { x_m: corner.x_m - 40.0, ..corner });
    let front = |zone| {
        let scene = Scene { zone, ..scene(&sample) };
        front::draw(&sample.measured, &scene.areas(), &scene.marks(), 400, 225).unwrap().into_rgb()
    };
    assert_eq!(front(Some(&behind[..])).as_raw(), front(None).as_raw());
}

#[test]
fn a_sample_without_points_or_objects_is_still_a_picture() {
    let mut sample = street();
    sample.measured.points.clear();
    sample.truth = Some(Truth::default());
    assert_eq!(drawn(&scene(&sample), "empty.png").dimensions(), SIZE_PX);
}

#[test]
fn the_panels_alone_have_their_sizes_and_point_at_a_box() {
    let sample = street();
    let focus = Some(sample.objects()[0].box_in_ego);
    let sizes = ((480, 270), (300, 270));
    let without = panels(&scene(&sample), None, sizes.0, sizes.1).unwrap();
    let with = panels(&scene(&sample), focus.as_ref(), sizes.0, sizes.1).unwrap();
    for (panel, size) in with.iter().zip([sizes.0, sizes.1]) {
        assert_eq!(panel.dimensions(), size);
    }
    for (with, without) in with.iter().zip(&without) {
        assert!(n_pixels_near(with, palette::TEXT) > n_pixels_near(without, palette::TEXT) + 50);
    }
}
