//! Each filter on small depth maps computed by hand, and what holds for all of them.

use proptest::prelude::*;

use super::*;

const NAN: f32 = f32::NAN;

fn options(texts: &[&str]) -> FilterOptions {
    let specs: Vec<FilterSpec> = texts.iter().map(|text| text.parse().unwrap()).collect();
    FilterOptions::new(&specs).unwrap()
}

fn chain(texts: &[&str], size: impl Into<ImageSize>) -> FilterChain {
    FilterChain::new(&options(texts), size.into())
}

/// One depth map through filters that keep the size.
fn through(chain: &mut FilterChain, depth_m: &[f32]) -> Vec<f32> {
    let mut depth_m = depth_m.to_vec();
    chain.apply(&mut depth_m, &(|| 0), &mut StageTimes::default()).unwrap();
    depth_m
}

fn filtered(text: &str, size: impl Into<ImageSize>, depth_m: &[f32]) -> Vec<f32> {
    through(&mut chain(&[text], size), depth_m)
}

#[track_caller]
fn assert_same(got: &[f32], expected: &[f32]) {
    assert_eq!(got.len(), expected.len());
    for (index, (got, expected)) in got.iter().zip(expected).enumerate() {
        let close = (got - expected).abs() <= 1e-6 * expected.abs();
        assert!(close || (got.is_nan() && expected.is_nan()), "{index}: {got} is not {expected}");
    }
}

fn refusal(text: &str) -> FilterError {
    text.parse::<FilterSpec>().unwrap_err()
}

mod writing {
    use super::*;

    #[test]
    fn defaults_are_librealsenses() {
        for (short, long) in [
            ("decimation", "decimation=factor:2"),
            ("decimation=3", "decimation=factor:3"),
            ("spatial", "spatial=magnitude:2,alpha:0.5,delta:0.02,fill:0"),
            ("temporal", "temporal=alpha:0.4,delta:0.02,persistence:3"),
            ("temporal=persistence:8", "temporal=alpha:0.4,delta:0.02,persistence:8"),
            ("holes", "holes=mode:farthest"),
            ("holes=2", "holes=mode:nearest"),
            ("holes=left", "holes=mode:left"),
        ] {
            let spec: FilterSpec = short.parse().unwrap();
            assert_eq!(spec.to_string(), long);
            assert_eq!(long.parse(), Ok(spec), "{short}");
        }
    }

    #[test]
    fn mistakes_are_refused_by_name() {
        assert_eq!(refusal("blur"), FilterError::UnknownFilter { text: "blur".to_owned() });
        let value = |filter, key, text: &str, expected: &str| {
            let (text, expected) = (text.to_owned(), expected.to_owned());
            FilterError::Value { filter, key, text, expected }
        };
        let range = "a number from `2` to `8`";
        assert_eq!(refusal("decimation=9"), value("decimation", "factor", "9", range));
        let range = "a number from `0.25` to `1`";
        assert_eq!(refusal("spatial=alpha:0.2"), value("spatial", "alpha", "0.2", range));
        assert!(matches!(refusal("temporal=radius:3"), FilterError::UnknownKey { filter: "temporal", .. }));
        assert!(matches!(refusal("spatial=0.5"), FilterError::NoSetting { filter: "spatial", .. }));
        let twice = FilterError::KeyTwice { filter: "temporal", key: "alpha" };
        assert_eq!(refusal("temporal=alpha:0,alpha:1"), twice);
        let modes = "`left` (or 0), `farthest` (1) or `nearest` (2)";
        assert_eq!(refusal("holes=3"), value("holes", "mode", "3", modes));
        for text in ["temporal=alpha:nan", "spatial=delta:0", "spatial=magnitude:2.5", "spatial=fill:-1"] {
            assert!(matches!(refusal(text), FilterError::Value { .. }), "{text}");
        }
    }

    #[test]
    fn a_filter_is_given_once() {
        let specs = ["holes", "holes=left"].map(|text| text.parse().unwrap());
        let error = FilterOptions::new(&specs).unwrap_err();
        assert!(matches!(error, FilterError::FilterTwice { filter: "holes", .. }), "{error}");
    }

    #[test]
    fn filters_run_in_librealsenses_order_whatever_the_order_given() {
        let options = options(&["holes", "temporal", "decimation", "spatial"]);
        let names: Vec<_> = options.specs().map(|spec| spec.to_string()).collect();
        let firsts = names.iter().map(|text| text.split('=').next().unwrap());
        assert_eq!(firsts.collect::<Vec<_>>(), ["decimation", "spatial", "temporal", "holes"]);
        assert!(FilterChain::new(&options, (4, 4).into()).names().eq(["spatial", "temporal", "holes"]));
    }

    #[test]
    fn a_depth_map_of_another_size_is_refused() {
        for name in ["spatial", "temporal", "holes"] {
            let mut chain = chain(&[name], (3, 2));
            let error = chain.apply(&mut [1.0; 5], &(|| 0), &mut StageTimes::default()).unwrap_err();
            let expected = FilterError::Size { filter: name, buffer: "depth", got: 5, expected: 6 };
            assert_eq!(error, expected);
        }
    }
}

mod decimation {
    use super::*;

    fn decimation(factor: u32, size: impl Into<ImageSize>) -> Decimation {
        let options = options(&[&format!("decimation={factor}")]).decimation().unwrap();
        Decimation::new(options, size.into()).unwrap()
    }

    fn depth(factor: u32, size: impl Into<ImageSize>, depth_m: &[f32]) -> Vec<f32> {
        let size = size.into();
        let mut decimation = decimation(factor, size);
        decimation.network_depth().copy_from_slice(depth_m);
        let mut small = vec![-1.0; ((size.width / factor) * (size.height / factor)) as usize];
        let rgb = vec![0; 3 * depth_m.len()];
        decimation.reduce(Appearance { rgb: &rgb, labels: None }, &mut small, None, false).unwrap();
        small
    }

    #[test]
    fn a_block_becomes_the_lower_median_of_its_measurements() {
        #[rustfmt::skip]
        let large = [
            1.0, 9.0,   2.0, NAN,   NAN, NAN,   5.0, NAN,   7.0,
            3.0, 4.0,   8.0, 6.0,   NAN, NAN,   NAN, 1.0,   7.0,
            7.0, 7.0,   7.0, 7.0,   7.0, 7.0,   7.0, 7.0,   7.0,
        ];
        assert_same(&depth(2, (9, 3), &large), &[3.0, 6.0, NAN, 1.0]);
    }

    #[test]
    fn a_block_of_three_has_a_middle() {
        let large = [9.0, 2.0, 7.0, 1.0, 5.0, 3.0, 8.0, 4.0, 6.0];
        assert_same(&depth(3, (3, 3), &large), &[5.0]);
    }

    #[test]
    fn no_depth_appears_between_two_surfaces() {
        for factor in 2..=3 {
            let large: Vec<f32> = (0..24 * 24).map(|i| if i % 24 < 11 { 1.0 } else { 5.0 }).collect();
            assert!(depth(factor, (24, 24), &large).iter().all(|&z| z == 1.0 || z == 5.0), "{factor}");
        }
    }

    #[test]
    fn from_factor_4_on_a_block_becomes_the_mean_of_its_measurements() {
        for factor in 4..=8_u32 {
            // One pixel of 9, one without depth, the others 3.
            let count = factor * factor;
            let large: Vec<f32> = (0..count)
                .map(|i| match i {
                    0 => 9.0,
                    1 => NAN,
                    _ => 3.0,
                })
                .collect();
            let expected = 3.0 + 6.0 / (count - 1) as f32;
            assert_same(&depth(factor, (factor, factor), &large), &[expected]);
            let none = vec![NAN; count as usize];
            assert_same(&depth(factor, (factor, factor), &none), &[NAN]);
        }
    }

    #[test]
    fn labels_are_the_most_frequent_and_colors_the_mean() {
        let mut decimation = decimation(2, (5, 2));
        let labels = [3, 1, 9, 2, 200, 1, 3, 2, 9, 200];
        let rgb: Vec<u8> = (0..10).flat_map(|i| [10 * i, 255, i]).collect();
        let (mut depth_m, mut small) = ([0.0; 2], [77; 2]);
        let full = Appearance { rgb: &rgb, labels: Some(&labels) };
        let appearance = decimation.reduce(full, &mut depth_m, Some(&mut small), true).unwrap();
        assert_eq!(appearance.labels, Some(&[1, 2][..]), "the smaller of equals");
        // Columns 0, 1 of both rows: 0, 1, 5, 6; columns 2, 3: 2, 3, 7, 8. The fifth column is dropped.
        assert_eq!(appearance.rgb, [30, 255, 3, 50, 255, 5]);
        assert_eq!(small, [1, 2]);
        let appearance = decimation.reduce(full, &mut depth_m, None, true).unwrap();
        assert_eq!(appearance.labels, Some(&[1, 2][..]), "for the cloud alone");
    }

    #[test]
    fn the_votes_of_one_block_do_not_count_in_the_next() {
        let mut decimation = decimation(2, (4, 2));
        let labels = [5, 5, 5, 6, 5, 5, 6, 6];
        let (mut depth_m, mut small) = ([0.0; 2], [0; 2]);
        let full = Appearance { rgb: &[0; 24], labels: Some(&labels) };
        decimation.reduce(full, &mut depth_m, Some(&mut small), false).unwrap();
        assert_eq!(small, [5, 6]);
    }

    #[test]
    fn buffers_of_another_size_and_images_smaller_than_a_block_are_refused() {
        let mut decimation = decimation(2, (4, 2));
        let full = Appearance { rgb: &[0; 24], labels: None };
        let error = decimation.reduce(full, &mut [0.0; 8], None, false).unwrap_err();
        let size = FilterError::Size { filter: "decimation", buffer: "depth", got: 8, expected: 2 };
        assert_eq!(error, size);
        let options = options(&["decimation=8"]).decimation().unwrap();
        let error = Decimation::new(options, (64, 7).into()).unwrap_err();
        assert_eq!(error, FilterError::TooSmall { width: 64, height: 7, factor: 8 });
    }
}

mod spatial {
    use super::*;

    #[test]
    fn a_row_of_three_computed_by_hand() {
        // Right: 1, then 1.4 -> 1.4 + (1 - 1.4) / 2 = 1.2, then 1.2 -> 1.2 + (1.2 - 1.2) / 2 = 1.2.
        // Left, of 1, 1.2, 1.2: 1.2, 1.2, then 1 -> 1 + (1.2 - 1) / 2 = 1.1.
        let got = filtered("spatial=magnitude:1,delta:0.5", (3, 1), &[1.0, 1.4, 1.2]);
        assert_same(&got, &[1.1, 1.2, 1.2]);
    }

    #[test]
    fn columns_are_smoothed_like_rows() {
        let got = filtered("spatial=magnitude:1,delta:0.5", (1, 3), &[1.0, 1.4, 1.2]);
        assert_same(&got, &[1.1, 1.2, 1.2]);
    }

    #[test]
    fn neighbors_are_compared_as_they_were_before_the_pass() {
        // 1.9 differs from the raw 1.5 by 0.4, though from the smoothed 1.25 by more than delta.
        // Right: 1, 1.25, 1.9 + (1.25 - 1.9) / 2 = 1.575. Left, of these: 1.575, 1.4125 and 1.20625.
        let got = filtered("spatial=magnitude:1,delta:0.6", (3, 1), &[1.0, 1.5, 1.9]);
        assert_same(&got, &[1.20625, 1.4125, 1.575]);
    }

    #[test]
    fn a_step_of_more_than_delta_stays_a_step() {
        let step: Vec<f32> = (0..8 * 6).map(|i| if i % 8 < 4 { 1.0 } else { 1.1 }).collect();
        assert_eq!(filtered("spatial=magnitude:5,alpha:0.25,delta:0.09", (8, 6), &step), step);
        assert_ne!(filtered("spatial=magnitude:5,alpha:0.25,delta:0.11", (8, 6), &step), step);
    }

    #[test]
    fn noise_on_a_surface_shrinks_and_the_edge_beside_it_does_not() {
        let noisy = |i: usize| (if i % 16 < 8 { 1.0 } else { 3.0 }) + (i * 7 % 5) as f32 * 0.004 - 0.008;
        let depth: Vec<f32> = (0..16 * 12).map(noisy).collect();
        let got = filtered("spatial", (16, 12), &depth);
        let spread = |depth: &[f32]| depth.iter().map(|z| (z - z.round()).powi(2)).sum::<f32>();
        assert!(spread(&got) < spread(&depth) / 4.0, "{} of {}", spread(&got), spread(&depth));
        assert!(got.iter().enumerate().all(|(i, z)| z.round() == if i % 16 < 8 { 1.0 } else { 3.0 }));
    }

    #[test]
    fn holes_stay_holes_and_separate_their_two_sides() {
        let got = filtered("spatial=delta:1", (5, 1), &[1.0, 1.0, NAN, 1.5, 1.5]);
        assert_same(&got, &[1.0, 1.0, NAN, 1.5, 1.5]);
    }

    #[test]
    fn alpha_one_changes_nothing() {
        let depth: Vec<f32> = (0..30).map(|i| 1.0 + (i % 4) as f32 * 0.003).collect();
        assert_eq!(filtered("spatial=alpha:1", (6, 5), &depth), depth);
    }

    #[test]
    fn holes_are_filled_along_the_row_as_far_as_asked() {
        let row = [NAN, NAN, NAN, 1.0, NAN, NAN, NAN, NAN, NAN, 5.0];
        // Two from the left, then two from the right.
        let two = [NAN, 1.0, 1.0, 1.0, 1.0, 1.0, NAN, 5.0, 5.0, 5.0];
        assert_same(&filtered("spatial=fill:1", (10, 1), &row), &two);
        let all = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0];
        assert_same(&filtered("spatial=fill:5", (10, 1), &row), &all);
    }
}

mod temporal {
    use super::*;

    /// The last of several frames of one pixel.
    fn after(text: &str, frames: &[f32]) -> f32 {
        let mut chain = chain(&[text], (1, 1));
        frames.iter().map(|&frame| through(&mut chain, &[frame])[0]).last().unwrap()
    }

    #[test]
    fn two_frames_computed_by_hand() {
        // 0.4 of the new and 0.6 of the old.
        assert_same(&[after("temporal=delta:0.5", &[1.0, 1.1])], &[1.04]);
        assert_same(&[after("temporal=delta:0.5", &[1.0, 1.1, 1.1])], &[1.064]);
    }

    #[test]
    fn a_change_of_more_than_delta_is_taken_at_once() {
        assert_eq!(after("temporal=delta:0.1", &[1.0, 1.0, 1.2]), 1.2);
        assert_eq!(after("temporal=delta:0.1", &[1.0, 1.0, 0.2]), 0.2);
    }

    #[test]
    fn a_static_scene_converges() {
        let noisy: Vec<f32> = (0..200).map(|i| 2.0 + if i % 2 == 0 { 0.01 } else { -0.01 }).collect();
        assert!((after("temporal=alpha:0.1,delta:0.05", &noisy) - 2.0).abs() < 0.001);
        let moved = [&[1.0][..], &[1.05; 60]].concat();
        assert!((after("temporal=delta:0.1", &moved) - 1.05).abs() < 1e-6);
        assert_eq!(after("temporal=alpha:0", &[1.0, 1.01, 1.015]), 1.0);
        assert_eq!(after("temporal=alpha:1", &[1.0, 1.01, 1.015]), 1.015);
    }

    #[test]
    fn each_persistence_keeps_what_its_rule_says() {
        // For each rule frames that are just enough for the hole behind them, and frames that are just too
        // few.
        let (v, x) = (1.0, NAN);
        let enough: [(usize, &[f32]); 8] = [
            (1, &[v; 8]),
            (2, &[v, v, x]),
            (3, &[v, v, x, x]),
            (4, &[v, x, x, x, x, x, x, v]),
            (5, &[v, x]),
            (6, &[v, x, x, x, x]),
            (7, &[v, x, x, x, x, x, x, x]),
            (8, &[v, x, x, x, x, x, x, x, x, x, x]),
        ];
        let too_few: [(usize, &[f32]); 8] = [
            (0, &[v; 20]),
            (1, &[v; 7]),
            (2, &[v, x, x]),
            (3, &[v, v, x, x, x]),
            (4, &[v, x, x, x, x, x, x, x, v]),
            (5, &[v, x, x]),
            (6, &[v, x, x, x, x, x]),
            (7, &[v, x, x, x, x, x, x, x, x]),
        ];
        for (frames, kept) in [(enough, true), (too_few, false)] {
            for (persistence, frames) in frames {
                let got = after(&format!("temporal=persistence:{persistence}"), &[frames, &[x]].concat());
                assert_eq!(got.is_finite(), kept, "persistence {persistence} after {frames:?}: {got}");
            }
        }
        assert!(after("temporal=persistence:8", &[x]).is_nan(), "there was never a depth");
    }

    #[test]
    fn another_surface_begins_with_an_empty_history() {
        let frames = [1.0, 1.0, 1.0, 5.0, NAN];
        assert!(after("temporal", &frames).is_nan(), "1 of the last 4 is of this surface");
        assert_eq!(after("temporal", &[1.0, 1.0, 5.0, 5.0, NAN]), 5.0);
    }

    #[test]
    fn a_reset_discards_the_history() {
        let mut chain = chain(&["temporal=persistence:8,delta:1"], (1, 1));
        through(&mut chain, &[1.0]);
        chain.reset();
        assert!(through(&mut chain, &[NAN])[0].is_nan());
        assert_eq!(through(&mut chain, &[1.5]), [1.5]);
    }
}

mod holes {
    use super::*;

    #[rustfmt::skip]
    const HOLED: [f32; 9] = [
        1.0, 2.0, 9.0,
        4.0, NAN, 9.0,
        7.0, 5.0, 9.0,
    ];

    #[test]
    fn a_hole_takes_one_of_the_depths_around_it() {
        for (mode, depth) in [("left", 4.0), ("farthest", 7.0), ("nearest", 1.0)] {
            let got = filtered(&format!("holes={mode}"), (3, 3), &HOLED);
            let mut expected = HOLED;
            expected[4] = depth;
            assert_eq!(got, expected, "{mode}");
        }
    }

    #[test]
    fn a_wide_hole_is_filled_from_its_left_side() {
        assert_same(&filtered("holes", (5, 1), &[NAN, 1.0, NAN, NAN, 3.0]), &[NAN, 1.0, 1.0, 1.0, 3.0]);
        assert_same(
            &filtered("holes=left", (3, 2), &[NAN, 1.0, NAN, 2.0, NAN, NAN]),
            &[NAN, 1.0, 1.0, 2.0, 2.0, 2.0],
        );
    }

    #[test]
    fn a_map_without_depth_is_not_filled() {
        assert!(filtered("holes=nearest", (3, 3), &[NAN; 9]).iter().all(|z| z.is_nan()));
    }
}

const ALL: [&str; 5] =
    ["spatial=magnitude:3", "spatial=alpha:0.25,fill:5", "temporal", "holes=nearest", "holes=left"];

proptest! {
    #[test]
    fn a_constant_map_stays_constant_to_the_bit(
        width in 1u32..12, height in 1u32..12, depth in 0.1..20f32, frames in 1usize..4,
    ) {
        let map = vec![depth; (width * height) as usize];
        let mut chain = chain(&["spatial=magnitude:5,fill:2", "temporal=alpha:0.1", "holes"], (width, height));
        for _ in 0..frames {
            prop_assert_eq!(&through(&mut chain, &map), &map);
        }
    }

    #[test]
    fn measured_pixels_stay_measured_and_within_the_range_of_the_input(
        cells in prop::collection::vec(prop::option::of(0.5..2f32), 40),
    ) {
        let map: Vec<f32> = cells.iter().map(|cell| cell.unwrap_or(NAN)).collect();
        let near = map.iter().copied().fold(NAN, f32::min) - 1e-5;
        let far = map.iter().copied().fold(NAN, f32::max) + 1e-5;
        for text in ALL {
            let mut chain = chain(&[text], (8, 5));
            for _ in 0..3 {
                let got = through(&mut chain, &map);
                for (before, after) in map.iter().zip(&got) {
                    prop_assert!(before.is_nan() || !after.is_nan(), "{} spreads holes", text);
                    prop_assert!(after.is_nan() || (near..=far).contains(after), "{} invents {}", text, after);
                }
            }
        }
    }

    #[test]
    fn spatial_without_fill_keeps_the_holes_as_they_are(
        cells in prop::collection::vec(prop::option::of(0.5..0.6f32), 42),
    ) {
        let map: Vec<f32> = cells.iter().map(|cell| cell.unwrap_or(NAN)).collect();
        let got = filtered("spatial=delta:1", (7, 6), &map);
        prop_assert!(map.iter().zip(&got).all(|(before, after)| before.is_nan() == after.is_nan()));
        prop_assert_eq!(count_invalid(&got), cells.iter().filter(|cell| cell.is_none()).count() as u32);
    }
}
