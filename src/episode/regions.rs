//! Ignored regions as messages and back; values that no consumer could use are a [`MessageFault`].

use super::convert::check_finite;
use super::error::MessageFault;
use super::messages::{own_time, wire};
use crate::geometry::Point2;
use crate::sample::IgnoredRegion;
use wire::ignored_region::Region;

pub(super) fn regions_message(time_ns: u64, regions: &[IgnoredRegion]) -> wire::IgnoredRegions {
    let regions = regions.iter().map(|region| {
        let region = match region {
            &IgnoredRegion::Image { left_px, top_px, right_px, bottom_px } => {
                Region::Image(wire::ImageRectangle { left_px, top_px, right_px, bottom_px })
            }
            IgnoredRegion::Ground { corners_in_ego_m } => {
                let corner = |corner: &Point2| wire::GroundPoint { x_m: corner.x_m, y_m: corner.y_m };
                Region::Ground(wire::GroundPolygon { corners: corners_in_ego_m.iter().map(corner).collect() })
            }
        };
        wire::IgnoredRegion { region: Some(region) }
    });
    wire::IgnoredRegions { timestamp: Some(own_time(time_ns)), regions: regions.collect() }
}

pub(super) fn region_of(message: wire::IgnoredRegion) -> Result<IgnoredRegion, MessageFault> {
    let region = match message.region {
        Some(Region::Image(wire::ImageRectangle { left_px, top_px, right_px, bottom_px })) => {
            IgnoredRegion::Image { left_px, top_px, right_px, bottom_px }
        }
        Some(Region::Ground(polygon)) => {
            let corner = |corner: wire::GroundPoint| Point2 { x_m: corner.x_m, y_m: corner.y_m };
            IgnoredRegion::Ground { corners_in_ego_m: polygon.corners.into_iter().map(corner).collect() }
        }
        None => return Err(MessageFault::new("region", "empty", "a rectangle or a polygon is needed")),
    };
    check_region(&region)?;
    Ok(region)
}

/// Whether a reader will accept the region.
pub(super) fn check_region(region: &IgnoredRegion) -> Result<(), MessageFault> {
    match region {
        IgnoredRegion::Image { left_px, top_px, right_px, bottom_px } => {
            let sides =
                [("left_px", left_px), ("top_px", top_px), ("right_px", right_px), ("bottom_px", bottom_px)];
            sides.into_iter().try_for_each(|(field, &found)| check_finite(field, found))
        }
        IgnoredRegion::Ground { corners_in_ego_m } => {
            if corners_in_ego_m.len() < 3 {
                let found = format!("{} points", corners_in_ego_m.len());
                return Err(MessageFault::new("corners", found, "at least three are needed"));
            }
            corners_in_ego_m.iter().try_for_each(|corner| {
                check_finite("corners.x_m", corner.x_m)?;
                check_finite("corners.y_m", corner.y_m)
            })
        }
    }
}
