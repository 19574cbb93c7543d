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
use bevy::shader::ShaderRef;

/// What the boxes are drawn with.
pub(super) type SurfaceMaterial = ExtendedMaterial<StandardMaterial, SurfaceExtension>;

/// Where a surface is to be found.
#[derive(Asset, AsBindGroup, TypePath, Clone, Debug)]
pub(super) struct SurfaceExtension {
    #[uniform(100)]
    pub(super) surface: SurfaceUniform,
}

/// As `Surface` in `surface.wgsl`.
#[derive(ShaderType, Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SurfaceUniform {
    pub(super) center: Vec3,
    pub(super) source: u32,
    pub(super) half_extents: Vec3,
    pub(super) padding: u32,
}

const SHADER: Handle<Shader> = uuid_handle!("0f6a9a0f-6f4a-4b43-9a0c-3b7f2f6d1c52");
/// The line of the shader in whose place the plain parts go.
const PLAIN_PARTS: &str = "//#include";

/// The shader, joined from the part that knows Bevy's modules and from parts of plain WGSL.
fn source() -> String {
    let plain = [include_str!("placeholder.wgsl"), include_str!("covers.wgsl")].join("\n");
    include_str!("surface.wgsl").replacen(PLAIN_PARTS, &plain, 1)
}

pub(super) fn plugin(app: &mut App) {
    let shader = Shader::from_wgsl(source(), "bevy_visfield/implicit/surface.wgsl");
    if let Err(error) = app.world_mut().resource_mut::<Assets<Shader>>().insert(SHADER.id(), shader) {
        error!("implicit surfaces will not be seen, their shader has no place: {error}");
    }
    app.add_plugins(MaterialPlugin::<SurfaceMaterial>::default());
}

/// The material of the box that draws what rays hit.
pub(super) fn solid(base: &StandardMaterial, surface: SurfaceUniform) -> SurfaceMaterial {
    // A mask, since an opaque material has no fragment shader where only depth is asked for.
    with_alpha(base, AlphaMode::Mask(0.5), surface)
}

/// The material of the box that draws edges.
pub(super) fn edges(base: &StandardMaterial, surface: SurfaceUniform) -> SurfaceMaterial {
    with_alpha(base, AlphaMode::Blend, surface)
}

fn with_alpha(base: &StandardMaterial, alpha_mode: AlphaMode, surface: SurfaceUniform) -> SurfaceMaterial {
    let base = StandardMaterial { alpha_mode, opaque_render_method: OpaqueRendererMethod::Forward, ..base.clone() };
    ExtendedMaterial { base, extension: SurfaceExtension { surface } }
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
            if key.mesh_key.intersection(MeshPipelineKey::BLEND_RESERVED_BITS) == MeshPipelineKey::BLEND_ALPHA {
                fragment.shader_defs.push("IMPLICIT_EDGES".into());
            }
            if key.mesh_key.contains(MeshPipelineKey::DEPTH_PREPASS) && key.mesh_key.msaa_samples() == 1 {
                fragment.shader_defs.push("IMPLICIT_READS_PREPASS".into());
            }
        }
        Ok(())
    }
}
