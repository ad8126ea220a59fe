//! The background around the objects of simulated scans, by kind. Each kind can be left out, to measure its effect.

/// One step from a plain scene to these ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Step {
    /// Things of a car's size that are none. Without: their place stays empty, as for each of the next four.
    Confusers,
    /// Houses, walls, fences, hedges and thickets along both sides of a road.
    Frontage,
    /// Poles, signs, bins, benches, parked bicycles.
    Furniture,
    /// Bushes and trees.
    Vegetation,
    /// What streets of `sim-any` have besides.
    Street,
    /// Rain, spray and exhaust of `sim-any`. Without: it is dry and warm.
    Weather,
}

mluc_ipc_types::values!(Step: Confusers "confusers" Frontage "frontage" Furniture "furniture" Vegetation "vegetation"
    Street "street" Weather "weather");

#[cfg(test)]
mod tests {
    use super::super::*;
    use super::*;
    use std::collections::HashSet;

    /// A training frame with these steps left out.
    fn frame_without(steps: &[Step], index: u32) -> SimulatedFrame {
        frame_of(Family::SimKitti, steps, index)
    }

    fn frame_of(family: Family, steps: &[Step], index: u32) -> SimulatedFrame {
        let mut options = ExportOptions::new(family, Split::Train, 1, 1, "".into());
        options.without = steps.to_vec();
        simulated(&options, index).expect("a frame").0
    }

    fn bits(point: &[f32; 4]) -> [u32; 4] {
        point.map(f32::to_bits)
    }

    #[test]
    fn every_step_changes_frames() {
        for step in Step::ALL {
            let of_any = matches!(step, Step::Street | Step::Weather);
            let family = [Family::SimKitti, Family::SimAny][usize::from(of_any)];
            let is_changed = |i| frame_of(family, &[step], i) != frame_of(family, &[], i);
            assert!((0..60).any(is_changed), "{step:?} changes nothing");
        }
    }

    #[test]
    fn without_confusers_nothing_else_moves() {
        use background::Thing;
        let confusers = Thing::Pallets.instance()..=Thing::Covered.instance();
        let mut seen = 0;
        for index in 0..4 {
            let plain = frame_without(&[Step::Confusers], index);
            let usual = frame_without(&[], index);
            let confuser = |instance: &&u16| confusers.contains(instance);
            seen += usual.instances.iter().filter(confuser).count();
            assert!(!plain.instances.iter().any(|i| confuser(&i)), "{index}");
            let of_plain: HashSet<_> = plain.points.iter().map(bits).collect();
            let points = usual.points.iter().zip(&usual.instances);
            let moved = points.filter(|(p, i)| !confuser(i) && !of_plain.contains(&bits(p)));
            // Only points between two surfaces depend on the background behind them.
            assert!(moved.count() < 100);
        }
        assert!(seen > 100, "{seen} points on confusers");
    }

    #[test]
    fn rain_spray_and_exhaust_are_seen_and_drops_answer_near_the_sensor() {
        use background::Thing::{Exhaust, Rain, Spray};
        let kinds = [Rain, Spray, Exhaust].map(background::Thing::instance);
        let (mut seen, mut far) = ([0; 3], 0);
        for frame in (0..60).map(|index| frame_of(Family::SimAny, &[], index)) {
            for ([x, y, z, _], instance) in frame.points.iter().zip(&frame.instances) {
                if let Some(kind) = kinds.iter().position(|kind| kind == instance) {
                    seen[kind] += 1;
                    far += usize::from(kind == 0 && x.hypot(*y).hypot(*z) > 10.0);
                }
            }
        }
        assert!(seen.iter().all(|points| *points > 10), "{seen:?}");
        assert!(far * 5 < seen[0], "{far} of {seen:?}");
    }
}
