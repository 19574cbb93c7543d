//! Makes the project's own example meshes in closed form, and bakes them.
//!
//! ```text
//! cargo run --package visfield_bake --example example_meshes -- assets/meshes
//! ```
//!
//! For each of `torus_knot`, `supershape` and `chair` it writes NAME.glb and, with default settings, NAME.vfield into the
//! folder. The same build writes the same bytes each time. All meshes are about 1.5 units tall, stand upright around the
//! origin (+Y is up) and wind counter-clockwise seen from outside.

mod chair;
mod glb;
mod supershape;
mod surface;
mod torus_knot;

use std::error::Error;
use std::path::Path;
use std::{env, fs};

use surface::Surface;
use visfield::file;
use visfield_bake::{BakeSettings, bake, read_meshes};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = env::args_os().nth(1).ok_or("which folder? for example: example_meshes assets/meshes")?;
    let folder = Path::new(&folder);
    fs::create_dir_all(folder)?;
    write(folder, "torus_knot", &torus_knot::torus_knot())?;
    write(folder, "supershape", &supershape::supershape())?;
    write(folder, "chair", &chair::chair())
}

fn write(folder: &Path, name: &str, surface: &Surface) -> Result<(), Box<dyn Error>> {
    let (mesh_path, field_path) = (folder.join(name).with_extension("glb"), folder.join(name).with_extension("vfield"));
    fs::write(&mesh_path, glb::encode(name, surface)?)?;
    // From the file, so that the field belongs to what users load.
    let meshes = read_meshes(&mesh_path)?;
    let fields =
        meshes.iter().map(|mesh| bake(mesh, &BakeSettings::default(), |_rays| ())).collect::<Result<Vec<_>, _>>()?;
    file::write(&field_path, &fields)?;
    let size = |path: &Path| fs::metadata(path).map(|metadata| metadata.len() / 1000);
    println!(
        "{name}: {} triangles, {} kB as .glb, {} kB as .vfield",
        surface.triangles.len(),
        size(&mesh_path)?,
        size(&field_path)?
    );
    Ok(())
}
