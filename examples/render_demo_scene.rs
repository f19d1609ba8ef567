//! Writes the picture of the README: a view of the demo scene beside its exact depth.
//!
//! `cargo run --release -p nunet-daemon --example render_demo_scene -- docs/images/demo.png`

use image::imageops::{FilterType, replace, resize};
use image::{Rgb, RgbImage};
use nunet_daemon::sink::files::{Results, depth_picture};
use nunet_daemon::source::demo::DemoScene;

const SIZE: (u32, u32) = (640, 480);
const SEED: u64 = 1;
const FRAME: u64 = 30;
const GAP: u32 = 8;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: render_demo_scene FILE.png")?;
    let pixels = SIZE.0 as usize * SIZE.1 as usize;
    let (mut rgb, mut depth) = (vec![0; 3 * pixels], vec![0.0; pixels]);
    DemoScene::new(SEED, SIZE.0, SIZE.1)?.render(FRAME, &mut rgb, Some(&mut depth), None);
    let view = RgbImage::from_raw(SIZE.0, SIZE.1, rgb).ok_or("the picture has another size")?;
    let results = Results { size: SIZE, depth: &depth, metric: true, labels: None, cloud: None };
    let colours = depth_picture(&results);
    let width = view.width() + GAP + colours.width();
    let mut both = RgbImage::from_pixel(width, SIZE.1, Rgb([255, 255, 255]));
    replace(&mut both, &view, 0, 0);
    replace(&mut both, &colours, (view.width() + GAP).into(), 0);
    resize(&both, width * 2 / 3, SIZE.1 * 2 / 3, FilterType::CatmullRom).save(path)?;
    Ok(())
}
