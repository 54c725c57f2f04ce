//! Randomness as a hash of (seed, place): no generator is shared, so results never depend on who asks first.

/// Mixes 64 bits thoroughly (the finaliser of SplitMix64, Steele, Lea & Flood 2014).
#[inline]
pub fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Hash of a seed and any number of coordinates.
#[inline]
pub fn hash(seed: u64, place: &[u64]) -> u64 {
    place.iter().fold(mix(seed), |h, &p| mix(h ^ p.wrapping_mul(0xD6E8_FEB8_6659_FD93)))
}

/// Uniform in [0, 1) from a hash.
#[inline]
pub fn unit(hash: u64) -> f32 {
    (hash >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
}

/// Uniform integer in `0..n` from a hash (`n` ≥ 1), without modulo bias worth naming.
#[inline]
pub fn below(hash: u64, n: u64) -> u64 {
    ((u128::from(hash) * u128::from(n)) >> 64) as u64
}

/// The numbers below `n` in an order by chance, each order equally likely (Fisher & Yates, by Durstenfeld 1964).
pub fn shuffled(seed: u64, n: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    (1..n).rev().for_each(|i| order.swap(i, below(hash(seed, &[i as u64]), i as u64 + 1) as usize));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_is_uniform_enough() {
        let n = 100_000u64;
        let mean = (0..n).map(|i| f64::from(unit(hash(7, &[i])))).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 0.005, "mean {mean}");
    }

    #[test]
    fn below_reaches_all_values() {
        let mut seen = [false; 7];
        (0..200).for_each(|i| seen[below(hash(1, &[i]), 7) as usize] = true);
        assert_eq!(seen, [true; 7]);
    }

    #[test]
    fn shuffling_keeps_every_number_and_reaches_every_order() {
        let mut orders = std::collections::BTreeSet::new();
        for seed in 0..200 {
            let order = shuffled(seed, 4);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3]);
            orders.insert(order);
        }
        assert_eq!(orders.len(), 24);
        assert!(shuffled(1, 0).is_empty());
    }
}
