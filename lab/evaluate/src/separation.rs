//! How well a score tells unknown from known, whatever the threshold.
//!
//! A higher score means more unknown; a score where lower means so is handed over with its sign turned.

/// Area under the ROC curve, 0..1: the chance that an unknown scores above a known, ties counting half.
/// `None` when either side is empty or a score is NaN.
pub fn auroc(known: &[f64], unknown: &[f64]) -> Option<f64> {
    let (known, unknown) = (sorted(known)?, sorted(unknown)?);
    let mut wins = 0.0;
    for score in &unknown {
        let below = known.partition_point(|k| k < score);
        let not_above = known.partition_point(|k| k <= score);
        wins += below as f64 + 0.5 * (not_above - below) as f64;
    }
    Some(wins / (known.len() as f64 * unknown.len() as f64))
}

/// Part of the known that is called unknown where the threshold lets 95 % of the unknown through (FPR at 95 % TPR),
/// 0..1. `None` when either side is empty or a score is NaN.
pub fn fpr95(known: &[f64], unknown: &[f64]) -> Option<f64> {
    let (known, unknown) = (sorted(known)?, sorted(unknown)?);
    // The highest threshold at or above which at least 95 % of the unknown lie.
    let passed_over = unknown.len() - (unknown.len() * 95).div_ceil(100);
    let threshold = unknown[passed_over];
    let called = known.len() - known.partition_point(|&k| k < threshold);
    Some(called as f64 / known.len() as f64)
}

fn sorted(scores: &[f64]) -> Option<Vec<f64>> {
    if scores.is_empty() || scores.iter().any(|s| s.is_nan()) {
        return None;
    }
    let mut sorted = scores.to_vec();
    sorted.sort_by(f64::total_cmp);
    Some(sorted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separated_equal_and_mixed_scores() {
        assert_eq!(auroc(&[0.1, 0.2], &[0.3, 0.9]), Some(1.0));
        assert_eq!(auroc(&[0.3, 0.9], &[0.1, 0.2]), Some(0.0));
        assert_eq!(auroc(&[0.5; 4], &[0.5; 3]), Some(0.5));
        assert_eq!(auroc(&[1.0, 3.0], &[2.0, 4.0]), Some(0.75));
        assert_eq!(auroc(&[], &[1.0]), None);
        assert_eq!(auroc(&[f64::NAN], &[1.0]), None);
    }

    #[test]
    fn false_alarms_at_95_percent() {
        let unknown: Vec<f64> = (1..=100).map(f64::from).collect();
        // 95 of them are 6 or more.
        assert_eq!(fpr95(&[5.0, 6.0, 7.0, 0.0], &unknown), Some(0.5));
        assert_eq!(fpr95(&[0.0], &[1.0]), Some(0.0));
        assert_eq!(fpr95(&[2.0], &[1.0]), Some(1.0));
    }
}
