//! Annotated boxes in the ego frame, with velocities as the devkit takes them from neighbouring key frames.

use nalgebra::{Isometry3, Vector3};

use super::tables::Tables;
use crate::geometry::{Box3, Ego, Point, Transform, World};
use crate::import::{ImportError, RawObject};
use crate::nuscenes::{SampleAnnotationRow, Token, isometry_of};

/// Neighbours further apart tell no velocity, seconds: the devkit's bound for one side; twice that for both.
const MAX_APART_S: f64 = 1.5;

/// An annotation, and the count of points that the log gives it.
#[derive(Debug)]
pub(super) struct Annotation {
    pub object: RawObject,
    pub n_lidar_points: i64,
}

/// The annotations of a sample.
///
/// # Errors
/// A row that is named is missing, or a pose or a size is not valid.
pub(super) fn of_sample(
    tables: &Tables,
    sample: &Token,
    world_from_ego: &Transform<World, Ego>,
) -> Result<Vec<Annotation>, ImportError> {
    let tokens = tables.annotations_of.get(sample).map_or(&[][..], Vec::as_slice);
    tokens.iter().map(|token| read(tables, token, world_from_ego)).collect()
}

fn read(
    tables: &Tables,
    token: &Token,
    world_from_ego: &Transform<World, Ego>,
) -> Result<Annotation, ImportError> {
    let named_by = format!("sample_annotation `{token}`");
    let row = tables.annotation.get(token, "the table itself")?;
    let instance = tables.instance.get(&row.instance_token, &named_by)?;
    let category = tables.category.get(&instance.category_token, &named_by)?;
    if !row.visibility_token.is_none() {
        tables.visibility.get(&row.visibility_token, &named_by)?;
    }
    let fail = |message: String| ImportError::at(&tables.annotation.path, format!("{named_by}: {message}"));
    let world_from_box =
        isometry_of(row.translation, row.rotation).map_err(|fault| fail(fault.to_string()))?;
    let ego_from_world = world_from_ego.inverse();
    let box_in_ego = upright(&(ego_from_world.isometry * world_from_box), row.size);
    box_in_ego.check().map_err(|fault| fail(fault.to_string()))?;
    let velocity = velocity_in_world(tables, row)?.map(|velocity| ego_from_world.rotate(&velocity));
    let velocity_in_ego_mps = velocity.map_or([f64::NAN; 2], |velocity| [velocity.x, velocity.y]);
    let (id, category) = (row.instance_token.to_string(), category.name.clone());
    let object = RawObject { id, category, box_in_ego, velocity_in_ego_mps };
    Ok(Annotation { object, n_lidar_points: row.num_lidar_pts })
}

/// A box with its heading alone: episodes hold boxes upright in the ego frame.
fn upright(ego_from_box: &Isometry3<f64>, [width_m, length_m, height_m]: [f64; 3]) -> Box3<Ego> {
    let center = Point::from_coords(ego_from_box.translation.vector.into());
    let yaw_rad = Transform::<Ego, Ego>::from_isometry(*ego_from_box).yaw_rad();
    Box3 { center, length_m, width_m, height_m, yaw_rad }
}

/// `box_velocity` of the devkit: from the annotation before to the one after, where they are near enough in time.
fn velocity_in_world(
    tables: &Tables,
    row: &SampleAnnotationRow,
) -> Result<Option<Vector3<f64>>, ImportError> {
    if row.prev.is_none() && row.next.is_none() {
        return Ok(None);
    }
    let named_by = format!("sample_annotation `{}`", row.token);
    let neighbour =
        |token: &Token| if token.is_none() { Ok(row) } else { tables.annotation.get(token, &named_by) };
    let time_s = |of: &SampleAnnotationRow| -> Result<f64, ImportError> {
        Ok(tables.sample.get(&of.sample_token, &named_by)?.timestamp as f64 * 1e-6)
    };
    let (first, last) = (neighbour(&row.prev)?, neighbour(&row.next)?);
    let apart_s = time_s(last)? - time_s(first)?;
    let is_between = !row.prev.is_none() && !row.next.is_none();
    let max_apart_s = if is_between { 2.0 * MAX_APART_S } else { MAX_APART_S };
    if !(apart_s > 0.0 && apart_s <= max_apart_s) {
        return Ok(None);
    }
    let moved = Vector3::from(last.translation) - Vector3::from(first.translation);
    Ok(Some(moved / apart_s))
}
