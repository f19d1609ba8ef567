use super::*;

const IMAGE: ImageSize = ImageSize::new(320, 240);
const DEPTH: ImageSize = ImageSize::new(160, 120);

fn noise(index: usize, frame: usize) -> f32 {
    let mixed = (index as u32).wrapping_mul(2_654_435_761) ^ (frame as u32).wrapping_mul(0x9e37_79b9);
    let mixed = (mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca6b);
    ((mixed ^ mixed >> 13) >> 8) as f32 / (1 << 24) as f32
}

/// A textured image, moved to the left by some pixels.
fn image(shift: usize) -> Vec<u8> {
    let value = |i: usize| {
        let (x, y) = ((i % 320 + shift) / 4, i / 320 / 4);
        (255.0 * noise(1000 * y + x, 7)) as u8
    };
    (0..IMAGE.pixel_count()).flat_map(|i| [value(i); 3]).collect()
}

fn depth(of: impl Fn(usize) -> f32) -> Vec<f32> {
    (0..DEPTH.pixel_count()).map(of).collect()
}

fn update(gauge: &mut StabilityGauge, rgb: &[u8], depth_m: &[f32]) -> Option<StabilityChange> {
    gauge.update(rgb, IMAGE, depth_m, DEPTH)
}

/// What the second of two frames gives.
fn change(rgb: [&[u8]; 2], depth_m: [&[f32]; 2]) -> Option<StabilityChange> {
    let mut gauge = StabilityGauge::default();
    assert_eq!(update(&mut gauge, rgb[0], depth_m[0]), None, "the first frame");
    update(&mut gauge, rgb[1], depth_m[1])
}

#[test]
fn the_same_depth_has_neither_drift_nor_flicker() {
    let (rgb, depth_m) = (image(0), depth(|i| 1.0 + 0.001 * i as f32));
    let same = Some(StabilityChange { drift: 0.0, flicker: 0.0 });
    assert_eq!(change([&rgb, &rgb], [&depth_m, &depth_m]), same);
}

#[test]
fn depth_times_a_factor_is_exactly_that_drift() {
    let rgb = image(0);
    let depth_m = depth(|i| 1.0 + (i % 97) as f32);
    for factor in [0.5, 1.25, 1.5, 4.0] {
        // These products are exact.
        let scaled = depth(|i| factor * depth_m[i]);
        let expected = StabilityChange { drift: factor - 1.0, flicker: 0.0 };
        assert_eq!(change([&rgb, &rgb], [&depth_m, &scaled]), Some(expected), "{factor}");
    }
}

#[test]
fn noise_is_flicker_and_no_drift() {
    let rgb = image(0);
    // Uniform from -10 to 10 percent: the median of the absolute value is 5 percent.
    let (still, noisy) = (depth(|_| 2.0), depth(|i| 2.0 * (1.0 + 0.2 * (noise(i, 3) - 0.5))));
    let found = change([&rgb, &rgb], [&still, &noisy]).unwrap();
    assert!(found.drift.abs() < 0.005 && (found.flicker - 0.05).abs() < 0.003, "{found:?}");
    let both = depth(|i| 1.1 * noisy[i]);
    let found = change([&rgb, &rgb], [&still, &both]).unwrap();
    assert!((found.drift - 0.1).abs() < 0.006 && (found.flicker - 0.055).abs() < 0.004, "{found:?}");
}

#[test]
fn noise_of_the_camera_is_no_change_of_the_image() {
    let depth_m = depth(|_| 2.0);
    let noisy = |frame: usize| -> Vec<u8> {
        let level = |(i, &value): (usize, &u8)| value.saturating_add((8.0 * noise(i, frame)) as u8);
        image(0).iter().enumerate().map(level).collect()
    };
    assert!(change([&noisy(1), &noisy(2)], [&depth_m, &depth_m]).is_some());
}

#[test]
fn a_moving_camera_and_another_light_are_unknown() {
    let (near, far) = (depth(|_| 2.0), depth(|_| 3.0));
    for shift in [1, 2, 4, 40] {
        assert_eq!(change([&image(0), &image(shift)], [&near, &far]), None, "{shift} pixels");
    }
    let brighter: Vec<u8> = image(0).iter().map(|value| value / 2 + 60).collect();
    assert_eq!(change([&image(0), &brighter], [&near, &far]), None);
}

#[test]
fn a_plain_image_is_unknown_because_motion_would_not_show() {
    let plain = vec![128; 3 * IMAGE.pixel_count()];
    let depth_m = depth(|_| 2.0);
    assert_eq!(change([&plain, &plain], [&depth_m, &depth_m]), None);
}

#[test]
fn something_that_moves_before_a_still_camera_does_not_count() {
    let (before, mut after) = (image(0), image(0));
    let (near, mut far) = (depth(|_| 2.0), depth(|_| 2.5));
    // The left third shows something else, at another depth.
    for (i, pixel) in after.chunks_mut(3).enumerate().filter(|(i, _)| i % 320 < 107) {
        pixel.fill((255.0 * noise(i / 4, 99)) as u8);
    }
    far.iter_mut().enumerate().filter(|(i, _)| i % 160 < 53).for_each(|(_, depth)| *depth = 0.7);
    let found = change([&before, &after], [&near, &far]).unwrap();
    assert_eq!(found, StabilityChange { drift: 0.25, flicker: 0.0 });
}

#[test]
fn points_without_depth_in_one_frame_do_not_count_and_no_depth_is_unknown() {
    let rgb = image(0);
    let whole = depth(|_| 2.0);
    let holes = depth(|i| match i % 160 / 8 % 4 {
        0 => f32::NAN,
        1 => 0.0,
        2 => f32::INFINITY,
        _ => 3.0,
    });
    let half = Some(StabilityChange { drift: 0.5, flicker: 0.0 });
    assert_eq!(change([&rgb, &rgb], [&whole, &holes]), half);
    let none = depth(|_| f32::NAN);
    for depths in [[&whole, &none], [&none, &whole], [&none, &none]] {
        assert_eq!(change([&rgb, &rgb], depths.map(|depth| &depth[..])), None);
    }
}

#[test]
fn a_reset_another_size_and_a_short_buffer_start_again() {
    let (rgb, depth_m) = (image(0), depth(|_| 2.0));
    let mut gauge = StabilityGauge::default();
    let full = vec![2.0; IMAGE.pixel_count()];
    assert_eq!(update(&mut gauge, &rgb, &depth_m), None);
    assert!(update(&mut gauge, &rgb, &depth_m).is_some());
    gauge.reset();
    assert_eq!(update(&mut gauge, &rgb, &depth_m), None);
    assert_eq!(gauge.update(&rgb, IMAGE, &full, IMAGE), None, "another size of depth");
    assert!(gauge.update(&rgb, IMAGE, &full, IMAGE).is_some());
    assert_eq!(gauge.update(&rgb[1..], IMAGE, &full, IMAGE), None, "a short buffer");
    assert_eq!(gauge.update(&rgb, IMAGE, &full, IMAGE), None);
    assert_eq!(gauge.update(&[], ImageSize::new(0, 0), &[], ImageSize::new(0, 0)), None);
}

#[test]
fn an_image_of_one_pixel_is_unknown() {
    let one = ImageSize::new(1, 1);
    let mut gauge = StabilityGauge::default();
    for _ in 0..2 {
        assert_eq!(gauge.update(&[1, 2, 3], one, &[1.0], one), None);
    }
}
