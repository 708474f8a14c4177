//! Bus stops: what stands behind the bays of a map, which are its lanes of type `stop`.

use super::network::flat;
use super::path::Path;
use super::plots::Furnishing;

/// A shelter and a sign behind each bay of type `stop`.
pub fn furnishings(network: &xodr::RoadNetwork) -> Vec<Furnishing> {
    let mut furnishings = Vec::new();
    for lane in network.lanes().iter().filter(|lane| lane.kind == xodr::LaneType::Stop) {
        let Some(mut path) = Path::new(lane.center.points().iter().map(|&point| flat(point))) else {
            continue;
        };
        let (is_backward, length_m) = (lane.direction == xodr::Direction::Backward, path.length_m());
        if is_backward {
            path = path.reversed();
        }
        // The bay is where the lane is widest.
        let width_m =
            |s_m: f64| f64::from(lane.width_at(if is_backward { length_m - s_m } else { s_m } as f32));
        let n = (path.length_m() / 2.0).ceil() as usize;
        let stations: Vec<f64> = (0..=n).map(|i| path.length_m() * i as f64 / n as f64).collect();
        let widest_m = stations.iter().map(|&s_m| width_m(s_m)).fold(0.0, f64::max);
        let full: Vec<f64> = stations.into_iter().filter(|&s_m| width_m(s_m) > 0.95 * widest_m).collect();
        let (Some(&first), Some(&last)) = (full.first(), full.last()) else { continue };
        for (share, behind_m, model) in [(0.5, 1.7, "bus_shelter"), (0.85, 0.6, "bus_stop")] {
            let s_m = first + (last - first) * share;
            furnishings.push(Furnishing {
                model: model.to_owned(),
                position: path.beside(s_m, -(widest_m / 2.0 + behind_m)),
                yaw_rad: path.heading_rad(s_m),
            });
        }
    }
    furnishings
}
