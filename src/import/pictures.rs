//! Cameras of an episode from a log's: checked against their calibration, rectified where the lens bends.

use std::io::Cursor;

use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat as Codec, RgbImage};
use nalgebra::Vector3;

use super::rectify::rectify;
use super::{Distortion, RawCamera, RawImage};
use crate::geometry::{Camera, Ego, Frame as _, Pinhole, Transform};
use crate::sample::{CameraView, EncodedImage, ImageFormat};

/// The virtual camera of a log without pictures: the simulator's.
const VIRTUAL_SIZE_PX: [u32; 2] = [800, 450];
const VIRTUAL_FOV_DEG: f64 = 70.0;
/// A principal point further than this share of the picture from its middle is told.
const MAX_OFF_MIDDLE: f64 = 0.25;
const VIRTUAL_PLACE_M: [f64; 3] = [1.5, 0.0, 1.6];

/// A camera as an episode has it. An error is a sentence: what was found, what would be right.
pub(super) fn view_of(camera: &RawCamera, jpeg_quality: u8) -> Result<CameraView, String> {
    let name = &camera.name;
    // Decoded even where the bytes stay, since a torn picture shows only then.
    let picture = match &camera.image {
        RawImage::Encoded(encoded) => encoded
            .decode()
            .map_err(|error| format!("the picture of `{name}` is torn or no picture ({error})"))?,
        RawImage::Pixels(picture) => picture.clone(),
        RawImage::Black => match camera.size_px {
            Some([width_px, height_px]) if width_px > 0 && height_px > 0 => {
                RgbImage::new(width_px, height_px)
            }
            found => {
                return Err(format!(
                    "there is no picture of `{name}`, and its calibration is for a size of {found:?} pixels; a size above 0 is needed"
                ));
            }
        },
    };
    if let RawImage::Encoded(encoded) = &camera.image
        && is_cut(encoded)
    {
        return Err(format!("the picture of `{name}` is cut short: the end of its data is missing"));
    }
    let (width_px, height_px) = picture.dimensions();
    if let Some([wanted_width_px, wanted_height_px]) = camera.size_px
        && (wanted_width_px, wanted_height_px) != (width_px, height_px)
    {
        return Err(format!(
            "the picture of `{name}` has {width_px} x {height_px} pixels; its calibration is for {wanted_width_px} x \
             {wanted_height_px}"
        ));
    }
    let [fx_px, skew, cx_px, _, fy_px, cy_px, ..] = camera.k;
    if !(fx_px.is_finite() && fy_px.is_finite() && fx_px > 0.0 && fy_px > 0.0) {
        return Err(format!(
            "the focal lengths of `{name}` are {fx_px} and {fy_px}; numbers above 0 are needed"
        ));
    }
    if !(cx_px.is_finite() && cy_px.is_finite() && skew.abs() < 1e-3) {
        return Err(format!(
            "the intrinsics of `{name}` have the middle ({cx_px}, {cy_px}) and the skew {skew}; a finite middle and no \
             skew are needed"
        ));
    }
    let forward = camera.ego_from_camera.rotate(&Vector3::z());
    let down = camera.ego_from_camera.rotate(&Vector3::y());
    if !(down.z < -0.5) {
        let [x, y, z] = [forward.x, forward.y, forward.z].map(|part| (part * 100.0).round() / 100.0);
        return Err(format!(
            "the camera `{name}` looks along ({x}, {y}, {z}) with its y axis not downwards; optical axes are needed: x \
             right, y down, z forward"
        ));
    }
    let image = match (&camera.image, &camera.distortion) {
        (RawImage::Black, _) => pack_black(&picture),
        (RawImage::Encoded(encoded), Distortion::None) => encoded.clone(),
        (_, Distortion::None) => pack_jpeg(&picture, jpeg_quality)?,
        (_, lens) => pack_jpeg(&rectify(&picture, &camera.k, lens), jpeg_quality)?,
    };
    let intrinsics = Pinhole { width_px, height_px, fx_px, fy_px, cx_px, cy_px };
    Ok(CameraView { name: name.clone(), ego_from_camera: camera.ego_from_camera, intrinsics, image })
}

/// Whether a JPEG lacks its end: decoders fill up what is missing. Some cameras pad what follows the end.
fn is_cut(encoded: &EncodedImage) -> bool {
    const PADDING: usize = 4096;
    let end = &encoded.bytes[encoded.bytes.len().saturating_sub(PADDING)..];
    encoded.format == ImageFormat::Jpeg && !end.windows(2).any(|pair| pair == [0xff, 0xd9])
}

/// Whether the episode's picture is another than the log's.
pub(super) fn is_changed(camera: &RawCamera) -> bool {
    match camera.image {
        RawImage::Encoded(_) => camera.distortion != Distortion::None,
        RawImage::Pixels(_) => true,
        RawImage::Black => false,
    }
}

/// A sentence on a calibration that is valid and yet hardly right.
pub(super) fn doubt(view: &CameraView) -> Option<String> {
    let (name, camera) = (&view.name, &view.intrinsics);
    let (width_px, height_px) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let off_x = (camera.cx_px / width_px - 0.5).abs();
    let off_y = (camera.cy_px / height_px - 0.5).abs();
    if off_x.max(off_y) > MAX_OFF_MIDDLE {
        return Some(format!(
            "the principal point of `{name}`, ({:.0}, {:.0}), is far from the middle of its picture of {width_px} x {height_px} \
             pixels: the calibration may be for another size",
            camera.cx_px, camera.cy_px
        ));
    }
    let ahead = view.ego_from_camera.rotate(&Vector3::z()).x;
    let is_front = name == Camera::NAME;
    (is_front && ahead < 0.5)
        .then(|| format!("the camera `{name}` does not look ahead; the front camera should"))
}

/// The black picture of the virtual camera.
pub(super) fn virtual_view() -> CameraView {
    let [width_px, height_px] = VIRTUAL_SIZE_PX;
    CameraView {
        name: "cam_front".to_owned(),
        ego_from_camera: Transform::<Ego, Camera>::looking_forward(Vector3::from(VIRTUAL_PLACE_M), 0.0),
        intrinsics: Pinhole::from_horizontal_fov(width_px, height_px, VIRTUAL_FOV_DEG.to_radians()),
        image: pack_black(&RgbImage::new(width_px, height_px)),
    }
}

fn pack_black(picture: &RgbImage) -> EncodedImage {
    let mut bytes = Vec::new();
    picture.write_to(&mut Cursor::new(&mut bytes), Codec::Png).expect("memory takes a picture");
    EncodedImage { format: ImageFormat::Png, bytes }
}

fn pack_jpeg(picture: &RgbImage, quality: u8) -> Result<EncodedImage, String> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode_image(picture)
        .map_err(|error| format!("a picture cannot be packed ({error})"))?;
    Ok(EncodedImage { format: ImageFormat::Jpeg, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> RawCamera {
        let mut bytes = Vec::new();
        RgbImage::new(80, 40).write_to(&mut Cursor::new(&mut bytes), Codec::Png).unwrap();
        RawCamera {
            name: "cam_front".to_owned(),
            time_ns: 0,
            ego_from_camera: Transform::looking_forward(Vector3::new(1.0, 0.0, 1.6), 0.0),
            size_px: Some([80, 40]),
            k: [50.0, 0.0, 39.5, 0.0, 50.0, 19.5, 0.0, 0.0, 1.0],
            distortion: Distortion::None,
            image: RawImage::Encoded(EncodedImage { format: ImageFormat::Png, bytes }),
        }
    }

    fn fault(change: impl FnOnce(&mut RawCamera)) -> String {
        let mut changed = camera();
        change(&mut changed);
        view_of(&changed, 95).unwrap_err()
    }

    #[test]
    fn a_plain_picture_keeps_its_bytes_and_its_calibration() {
        let view = view_of(&camera(), 95).unwrap();
        assert_eq!(RawImage::Encoded(view.image), camera().image);
        assert_eq!((view.intrinsics.cx_px, view.intrinsics.cy_px), (39.5, 19.5));
    }

    #[test]
    fn what_does_not_fit_is_told() {
        assert!(fault(|camera| camera.size_px = Some([1600, 900])).contains("80 x 40"));
        assert!(fault(|camera| camera.k[0] = 0.0).contains("above 0"));
        let flat = Transform::from_xyz_yaw(1.0, 0.0, 1.6, 0.0);
        assert!(fault(|camera| camera.ego_from_camera = flat).contains("optical axes"));
        let torn = |camera: &mut RawCamera| {
            let RawImage::Encoded(encoded) = &mut camera.image else { unreachable!() };
            encoded.bytes.truncate(50);
        };
        assert!(fault(torn).contains("torn"));
    }

    #[test]
    fn a_bent_picture_is_rectified_and_packed_anew() {
        let mut bent = camera();
        bent.distortion = Distortion::PlumbBob([-0.1, 0.0, 0.0, 0.0, 0.0]);
        let view = view_of(&bent, 95).unwrap();
        assert_eq!(view.image.format, ImageFormat::Jpeg);
        assert_eq!(view.image.decode().unwrap().dimensions(), (80, 40));
        assert!(is_changed(&bent) && !is_changed(&camera()));
    }

    #[test]
    fn a_missing_picture_is_black_and_keeps_its_calibration() {
        let dark = RawCamera { image: RawImage::Black, ..camera() };
        let view = view_of(&dark, 95).unwrap();
        let picture = view.image.decode().unwrap();
        assert!(picture.dimensions() == (80, 40) && picture.iter().all(|value| *value == 0));
        assert!(view.intrinsics.cx_px == 39.5 && !is_changed(&dark));
        assert!(view_of(&RawCamera { size_px: None, ..dark }, 95).unwrap_err().contains("size"));
    }

    #[test]
    fn a_jpeg_that_is_cut_short_is_told() {
        let mut whole = RgbImage::new(80, 40);
        whole.pixels_mut().enumerate().for_each(|(i, pixel)| pixel.0 = [(i % 251) as u8, (i % 89) as u8, 7]);
        let mut packed = pack_jpeg(&whole, 95).unwrap();
        let fault = |image: &EncodedImage| {
            view_of(&RawCamera { image: RawImage::Encoded(image.clone()), ..camera() }, 95).err()
        };
        assert_eq!(fault(&packed), None);
        packed.bytes.truncate(packed.bytes.len() - 40);
        assert!(fault(&packed).is_some_and(|told| told.contains("cut short") || told.contains("torn")));
    }
}
