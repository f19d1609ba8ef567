//! Writes views of the ray-cast test room with their exact depth, as a dataset: `rgb/` and `depth/` (16-bit
//! millimeters) as `nunetd eval` and the recipe read them.
//!
//! `cargo run --release -p nunet-daemon --example render_demo_scene -- DIR`

use std::error::Error;
use std::path::Path;

use image::{ImageBuffer, Luma, RgbImage};
use nunet_testkit::demo::DemoScene;
use nunet_types::ImageSize;

const SIZE: ImageSize = ImageSize::new(640, 480);
const SEED: u64 = 1;
/// Two seconds at 30 frames per second, five images.
const FRAMES: [u64; 5] = [0, 15, 30, 45, 60];

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: render_demo_scene DIR")?;
    let path = Path::new(&path);
    for folder in ["rgb", "depth"] {
        std::fs::create_dir_all(path.join(folder))?;
    }
    for frame in FRAMES {
        let (view, depth_m) = view(frame)?;
        view.save(path.join(format!("rgb/demo_{frame:02}.png")))?;
        let millimeters = depth_m.iter().map(|meters| (meters * 1000.0).round() as u16).collect();
        let depth: Option<ImageBuffer<Luma<u16>, Vec<u16>>> =
            ImageBuffer::from_raw(SIZE.width, SIZE.height, millimeters);
        depth.ok_or("depth has another size")?.save(path.join(format!("depth/demo_{frame:02}.png")))?;
    }
    Ok(())
}

/// A view and its depth, meters.
fn view(frame: u64) -> Result<(RgbImage, Vec<f32>), Box<dyn Error>> {
    let pixels = SIZE.pixel_count();
    let (mut rgb, mut depth_m) = (vec![0; 3 * pixels], vec![0.0; pixels]);
    DemoScene::new(SEED, SIZE.width, SIZE.height).render(frame, &mut rgb, Some(&mut depth_m), None);
    Ok((RgbImage::from_raw(SIZE.width, SIZE.height, rgb).ok_or("the image has another size")?, depth_m))
}
