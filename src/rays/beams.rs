//! Beams of a sensor, gathered into packets of neighbours.

use std::ops::Range;

use nalgebra::Vector3;

use super::frustum::RAYS;

/// A packet is this much wider than high, as things in a street are wide and stand one above the other.
const STRETCH: f64 = 4.0;
/// Least cosine between a ray of a packet and its mean.
const MIN_COS: f64 = 0.8;

/// Directions from one origin, in the sensor's frame (z up), in packets of neighbours.
#[derive(Debug, Clone)]
pub struct Beams {
    pub(super) directions: Vec<Vector3<f64>>,
    /// Indices of directions, packet by packet.
    pub(super) order: Vec<u32>,
    pub(super) packets: Vec<Range<usize>>,
}

impl Beams {
    /// Of directions of any length but zero.
    #[must_use]
    pub fn new(directions: &[Vector3<f64>]) -> Self {
        let mut order: Vec<u32> = (0..directions.len() as u32).collect();
        let mut packets = Vec::new();
        if !directions.is_empty() {
            let units: Vec<Vector3<f64>> = directions.iter().map(Vector3::normalize).collect();
            split(&units, &mut order, 0, &mut packets);
        }
        Self { directions: directions.to_vec(), order, packets }
    }
}

fn split(units: &[Vector3<f64>], order: &mut [u32], start: usize, packets: &mut Vec<Range<usize>>) {
    let rays = || order.iter().map(|&ray| &units[ray as usize]);
    let mean = rays().sum::<Vector3<f64>>().normalize();
    let is_narrow = rays().all(|ray| ray.dot(&mean) >= MIN_COS);
    if order.len() == 1 || (order.len() <= RAYS && is_narrow) {
        packets.push(start..start + order.len());
        return;
    }
    let spread = |of: fn(&Vector3<f64>) -> f64| {
        let values = rays().map(of);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    let of = if STRETCH * spread(height) > spread(azimuth) { height } else { azimuth };
    // Whole packets before the cut, where there are as many.
    let half = order.len() / 2;
    let middle = if half >= RAYS { half.next_multiple_of(RAYS) } else { half };
    order.select_nth_unstable_by(middle, |&a, &b| {
        of(&units[a as usize]).total_cmp(&of(&units[b as usize])).then(a.cmp(&b))
    });
    let (before, after) = order.split_at_mut(middle);
    split(units, before, start, packets);
    split(units, after, start + middle, packets);
}

fn height(unit: &Vector3<f64>) -> f64 {
    unit.z
}

/// Rises with the azimuth from -pi to pi, at the speed of radians in the mean.
fn azimuth(unit: &Vector3<f64>) -> f64 {
    let quarters = unit.y / (unit.x.abs() + unit.y.abs()).max(f64::MIN_POSITIVE);
    let turned = if unit.x >= 0.0 { quarters } else { 2f64.copysign(quarters) - quarters };
    turned * std::f64::consts::FRAC_PI_2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ray_is_in_one_packet_and_packets_are_full_and_narrow() {
        let turn: Vec<Vector3<f64>> = (0..360)
            .flat_map(|azimuth| (-15..=15).map(move |elevation| (f64::from(azimuth), f64::from(elevation))))
            .map(|(a, e)| (a.to_radians(), e.to_radians()))
            .map(|(a, e)| Vector3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin()))
            .collect();
        let beams = Beams::new(&turn);
        let mut seen = beams.order.clone();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(i, &ray)| i == ray as usize));
        assert_eq!(beams.packets.iter().map(Range::len).sum::<usize>(), turn.len());
        assert!(beams.packets.len() <= turn.len() / RAYS + 12, "{}", beams.packets.len());
        for packet in &beams.packets {
            let rays: Vec<_> = beams.order[packet.clone()].iter().map(|&ray| turn[ray as usize]).collect();
            let mean = rays.iter().sum::<Vector3<f64>>().normalize();
            assert!(rays.iter().all(|ray| ray.dot(&mean) >= MIN_COS));
        }
    }

    #[test]
    fn opposite_rays_are_kept_apart() {
        let beams = Beams::new(&[Vector3::x(), -Vector3::x(), Vector3::z()]);
        assert_eq!(beams.packets.len(), 3);
        assert!(Beams::new(&[]).packets.is_empty());
    }
}
