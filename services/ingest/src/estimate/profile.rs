//! Compares an estimate with the profiles of real products, and makes a profile from the estimate.

use super::SensorEstimate;
use mluc_model::SensorProfile;

/// Used where scans do not show them: shortest range, noise of a range, angle between columns. Guesses.
const RANGE_SHORTEST_M: f32 = 0.5;
const RANGE_NOISE_M: f32 = 0.02;
const AZIMUTH_STEP_DEG: f32 = 0.2;
/// The sensor can be a product if its beams are this near to the product's, degrees; a guess.
const PRODUCT_DEG: f32 = 0.1;
/// Tolerance of the number of beams, as a factor; a guess.
pub(crate) const BEAMS_FACTOR: f32 = 1.4;
/// Products are alike if their distances differ by less than this.
const ALIKE_DEG: f32 = 0.005;

/// Result of [`SensorEstimate::nearest`].
#[derive(Clone, Debug)]
pub struct Nearest {
    /// Names of the products that are alike.
    pub names: Vec<&'static str>,
    /// Profile of the first of these products.
    pub profile: SensorProfile,
    /// Distance to this profile, degrees; see [`SensorEstimate::distance_deg`].
    pub distance_deg: f32,
}

impl SensorEstimate {
    /// Distance from a profile's beams, degrees: the mean distance to the nearest beam, in both directions. It leaves out the profile's beams above
    /// the found field, which see the sky. Lines that wave have no peaks. `None` where there is nothing to compare.
    pub fn distance_deg(&self, profile: &SensorProfile) -> Option<f32> {
        let has_peaks = profile.units.len() < 2 && profile.wave.is_none();
        if self.elevations_deg.is_empty() || !has_peaks {
            return None;
        }
        let mean = |from: &[f32], to: &[f32], top_deg: f32| {
            let from = from.iter().filter(|deg| **deg <= top_deg);
            let nearest = |deg: &f32| to.iter().map(|t| (t - deg).abs()).fold(f32::MAX, f32::min);
            let (sum, count) =
                from.fold((0.0, 0.0), |(sum, count), deg| (sum + nearest(deg), count + 1.0));
            (count > 0.0).then(|| sum / count)
        };
        let (own, other) = (&self.elevations_deg, &profile.elevations_deg);
        let there = mean(own, other, 90.0)?;
        let back = mean(other, own, own[0] + 0.5)?;
        Some((there + back) / 2.0)
    }

    /// The products with about as many beams whose beams lie nearest; more than one where products are alike.
    pub fn nearest(&self) -> Option<Nearest> {
        let mut best: Option<Nearest> = None;
        let measured = SensorProfile::names().filter_map(|name| {
            let profile = SensorProfile::load(name).ok()?;
            // Its upper beams may see only the sky.
            let top_deg = self.vertical_field_deg[0] + 0.5;
            let beams = profile.elevations_deg.iter().filter(|deg| **deg < top_deg);
            let ratio = self.beams as f32 / beams.count() as f32;
            if !(1.0 / BEAMS_FACTOR..=BEAMS_FACTOR).contains(&ratio) {
                return None;
            }
            Some(Nearest { names: vec![name], distance_deg: self.distance_deg(&profile)?, profile })
        });
        for found in measured {
            match &mut best {
                Some(best) if (found.distance_deg - best.distance_deg).abs() < ALIKE_DEG => {
                    best.names.extend(found.names);
                }
                Some(best) if found.distance_deg > best.distance_deg => (),
                _ => best = Some(found),
            }
        }
        best
    }

    /// The products that this sensor can be.
    pub fn product(&self) -> Option<Nearest> {
        let near = self.nearest().filter(|_| self.are_beams_clear);
        near.filter(|near| near.distance_deg < PRODUCT_DEG)
    }

    /// A profile of this sensor. Its beams are the peaks where beams are clear, else as many as the returns per column, evenly spread over the vertical
    /// field. The caller can give the noise of its ranges, m.
    pub fn profile(&self, name: &str, range_noise_m: Option<f32>) -> SensorProfile {
        let [top, bottom] = self.vertical_field_deg;
        let beams = self.beams.max(1);
        let gaps = (beams - 1).max(1) as f32;
        let even = |beam: u32| top + (bottom - top) * beam as f32 / gaps;
        // Scans do not show everything, or not in every place: the rest comes from a product with the same beams.
        let product = self.product().map(|near| near.profile);
        // Beams that see only the sky.
        let is_above =
            |deg: &&f32| **deg > self.elevations_deg.first().map_or(90.0, |top| top + 0.5);
        let above = product.iter().flat_map(|p| p.elevations_deg.iter().filter(is_above));
        let above: Vec<f32> = above.copied().collect();
        let elevations_deg = if self.are_beams_clear {
            [&above[..], &self.elevations_deg].concat()
        } else {
            (0..beams).map(even).collect()
        };
        let longest_m = self.range_longest_m.clamp(5.0, 500.0);
        let has_more = product.as_ref().is_some_and(|p| p.range_m[1] > longest_m);
        let unseen = [
            (true, "range_m (shortest)"),
            (has_more, "range_m (longest)"),
            (!above.is_empty(), "elevations_deg (highest)"),
            (range_noise_m.is_none(), "range_noise_m"),
            (self.azimuth_step_deg.is_none(), "azimuth_step_deg"),
        ];
        let unseen: Vec<&str> = unseen.iter().filter(|u| u.0).map(|u| u.1).collect();
        let noise_m = range_noise_m.or(product.as_ref().map(|p| p.range_noise_m));
        SensorProfile {
            name: name.to_string(),
            source: format!(
                "estimated from {} scans; not seen in them, so a product's or a guess: {}",
                self.scans,
                unseen.join(", ")
            ),
            elevations_deg,
            azimuth_step_deg: (self.azimuth_step_deg)
                .or(product.as_ref().map(|p| p.azimuth_step_deg))
                .unwrap_or(AZIMUTH_STEP_DEG),
            field_deg: (self.field_deg[1] < 360.0).then_some(self.field_deg),
            range_m: product.as_ref().map_or([RANGE_SHORTEST_M, longest_m], |p| {
                [p.range_m[0], p.range_m[1].max(longest_m)]
            }),
            range_noise_m: noise_m.unwrap_or(RANGE_NOISE_M).min(0.5),
            height_m: self.height_m.filter(|height_m| (0.05..=10.0).contains(height_m)),
            pitch_deg: self.pitch_deg.clamp(-30.0, 30.0),
            roll_deg: self.roll_deg.clamp(-30.0, 30.0),
            ..SensorProfile::default()
        }
    }
}
