//! The material of the boxes: a `StandardMaterial`, with shaders that find the surface within the box.

use bevy::asset::uuid_handle;
use bevy::material::{AlphaMode, OpaqueRendererMethod};
use bevy::mesh::MeshVertexBufferLayoutRef;
use bevy::pbr::{
    ExtendedMaterial, MaterialExtension, MaterialExtensionKey, MaterialExtensionPipeline, MaterialPlugin,
    MeshPipelineKey,
};
use bevy::prelude::*;
use bevy::render::render_resource::{AsBindGroup, RenderPipelineDescriptor, ShaderType, SpecializedMeshPipelineError};
use bevy::render::storage::ShaderBuffer;
use bevy::shader::ShaderRef;
use visfield::distance::DistanceField;
use visfield::gpu::distance_source;
use visfield::gpu::layout::DistanceData;
use visfield::shape::Shape;

/// What the boxes are drawn with.
pub(super) type SurfaceMaterial = ExtendedMaterial<StandardMaterial, SurfaceExtension>;

/// Where a surface is to be found.
#[derive(Asset, AsBindGroup, TypePath, Clone, Debug)]
pub(super) struct SurfaceExtension {
    #[uniform(100)]
    pub(super) surface: SurfaceUniform,
    /// The codes or nodes of the distances.
    #[storage(101, read_only)]
    pub(super) pool: Handle<ShaderBuffer>,
}

/// As `Surface` in `surface.wgsl`.
#[derive(ShaderType, Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SurfaceUniform {
    /// Of the box around the surface, in the space of the mesh.
    pub(super) center: Vec3,
    /// Lengths of the distances' space to one of the mesh's.
    units: f32,
    pub(super) half_extents: Vec3,
    /// Whether it is known to be convex.
    convex: u32,
    /// The box's centre in the space of the distances.
    distance_center: Vec3,
    padding: u32,
    distances: DistanceUniform,
}

/// As `DistanceSource` of the library's shaders.
#[derive(ShaderType, Clone, Copy, Debug, Default, PartialEq)]
struct DistanceUniform {
    low: Vec3,
    nodes: u32,
    high: Vec3,
    first_word: u32,
    row: u32,
    layer: u32,
    bits: u32,
    threshold: f32,
    code_low: f32,
    code_step: f32,
}

impl SurfaceUniform {
    /// A surface whose distances start with the first word of its pool.
    pub(super) fn new(distance: &DistanceField) -> Self {
        let data = DistanceData::new(distance, 0);
        let (low, high) = distance.bounds();
        let to_distance = distance.distance_from_mesh();
        let units = to_distance.matrix3.x_axis.x;
        let distance_center = (low + high) * 0.5;
        let center = (distance_center.as_dvec3() - to_distance.translation) / units;
        Self {
            center: center.as_vec3(),
            units: units as f32,
            half_extents: (high - low) * (0.5 / units as f32),
            convex: u32::from(distance.shape().is_some_and(Shape::is_convex)),
            distance_center,
            padding: 0,
            distances: DistanceUniform {
                low,
                nodes: data.nodes,
                high,
                first_word: data.first_word,
                row: data.row,
                layer: data.layer,
                bits: data.bits,
                threshold: data.threshold,
                code_low: data.code_low,
                code_step: data.code_step,
            },
        }
    }
}

const SHADER: Handle<Shader> = uuid_handle!("0f6a9a0f-6f4a-4b43-9a0c-3b7f2f6d1c52");
/// The line of the shader in whose place the plain parts go.
const PLAIN_PARTS: &str = "//#include";
/// The same for what only glass needs.
const GLASS_PART: &str = "//#glass";

/// The shader, joined from the part that knows Bevy's modules and from parts of plain WGSL.
fn source() -> String {
    let plain = distance_source() + include_str!("covers.wgsl");
    include_str!("surface.wgsl").replacen(PLAIN_PARTS, &plain, 1).replacen(GLASS_PART, include_str!("glass.wgsl"), 1)
}

pub(super) fn plugin(app: &mut App) {
    let shader = Shader::from_wgsl(source(), "bevy_visfield/implicit/surface.wgsl");
    if let Err(error) = app.world_mut().resource_mut::<Assets<Shader>>().insert(SHADER.id(), shader) {
        error!("implicit surfaces will not be seen, their shader has no place: {error}");
    }
    app.add_plugins(MaterialPlugin::<SurfaceMaterial>::default());
}

/// The material of the box that draws what rays hit.
pub(super) fn solid(base: &StandardMaterial, extension: SurfaceExtension) -> SurfaceMaterial {
    // A mask, since an opaque material has no fragment shader where only depth is asked for.
    with_alpha(base, AlphaMode::Mask(0.5), extension)
}

/// The material of the box that draws edges.
pub(super) fn edges(base: &StandardMaterial, extension: SurfaceExtension) -> SurfaceMaterial {
    with_alpha(base, AlphaMode::Blend, extension)
}

fn with_alpha(base: &StandardMaterial, alpha_mode: AlphaMode, extension: SurfaceExtension) -> SurfaceMaterial {
    let base = StandardMaterial { alpha_mode, opaque_render_method: OpaqueRendererMethod::Forward, ..base.clone() };
    ExtendedMaterial { base, extension }
}

impl MaterialExtension for SurfaceExtension {
    fn vertex_shader() -> ShaderRef {
        SHADER.into()
    }

    fn fragment_shader() -> ShaderRef {
        SHADER.into()
    }

    fn prepass_vertex_shader() -> ShaderRef {
        SHADER.into()
    }

    fn prepass_fragment_shader() -> ShaderRef {
        SHADER.into()
    }

    fn enable_shadows() -> bool {
        false
    }

    fn specialize(
        _pipeline: &MaterialExtensionPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        _layout: &MeshVertexBufferLayoutRef,
        key: MaterialExtensionKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        // The vertex shader chooses the faces.
        descriptor.primitive.cull_mode = None;
        if let Some(fragment) = &mut descriptor.fragment {
            let edges = key.mesh_key.intersection(MeshPipelineKey::BLEND_RESERVED_BITS) == MeshPipelineKey::BLEND_ALPHA;
            if edges {
                fragment.shader_defs.push("IMPLICIT_EDGES".into());
            }
            // Bevy's prepass is without what reads the picture of the rest.
            let glass = fragment.shader_defs.contains(&"STANDARD_MATERIAL_SPECULAR_TRANSMISSION".into());
            if (edges || !glass)
                && key.mesh_key.contains(MeshPipelineKey::DEPTH_PREPASS)
                && key.mesh_key.msaa_samples() == 1
            {
                fragment.shader_defs.push("IMPLICIT_READS_PREPASS".into());
            }
        }
        Ok(())
    }
}
