//! Every composed entry point validates, and Rust's layouts are WGSL's.

use std::mem::offset_of;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use visfield::gpu::layout::{CapGridData, FrameUniform, InstanceData, LightData};

fn parse(source: &str) -> naga::Module {
    let module =
        naga::front::wgsl::parse_str(source).unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    // WebGPU has it, and so have all its native backends.
    let capabilities = Capabilities::default() | Capabilities::SHADER_FLOAT16_IN_FLOAT32;
    Validator::new(ValidationFlags::all(), capabilities)
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    module
}

fn assert_layout(module: &naga::Module, name: &str, size: usize, offsets: &[(&str, usize)]) {
    let (_, structure) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).expect(name);
    let naga::TypeInner::Struct { members, span } = &structure.inner else { panic!("{name} is no struct") };
    assert_eq!(*span as usize, size, "size of {name}");
    let reflected: Vec<_> = members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset as usize)).collect();
    assert_eq!(reflected, offsets, "members of {name}");
}

#[test]
fn shaders_validate() {
    let entry_points = |source: String| -> Vec<String> {
        parse(&source).entry_points.into_iter().map(|entry_point| entry_point.name).collect()
    };
    assert_eq!(entry_points(visfield::gpu::tiles_source()), ["tile_bounds", "list_blocks", "list_tiles"]);
    assert_eq!(entry_points(visfield::gpu::trace_source()), ["trace"]);
    assert_eq!(entry_points(visfield::gpu::accumulate_source()), ["accumulate"]);
    assert_eq!(entry_points(visfield::gpu::resolve_source()), ["resolve"]);
    assert_eq!(entry_points(visfield::gpu::denoise_source()), ["denoise_rows", "denoise_columns"]);
}

#[test]
fn rust_layouts_are_the_shaders_layouts() {
    let module = parse(&visfield::gpu::trace_source());
    assert_layout(
        &module,
        "Instance",
        size_of::<InstanceData>(),
        &[
            ("field_from_world", offset_of!(InstanceData, field_from_world)),
            ("cap_from_world", offset_of!(InstanceData, cap_from_world)),
            ("distance_from_world", offset_of!(InstanceData, distance_from_world)),
            ("center", offset_of!(InstanceData, center)),
            ("radius", offset_of!(InstanceData, radius)),
            ("first_byte", offset_of!(InstanceData, first_byte)),
            ("entries", offset_of!(InstanceData, entries)),
            ("exits", offset_of!(InstanceData, exits)),
            ("encoding", offset_of!(InstanceData, encoding)),
            ("cap_grid", offset_of!(InstanceData, cap_grid)),
            ("ambient_source", offset_of!(InstanceData, ambient_source)),
            ("stretched", offset_of!(InstanceData, stretched)),
            ("light_source", offset_of!(InstanceData, light_source)),
            ("flags", offset_of!(InstanceData, flags)),
            ("small_light_source", offset_of!(InstanceData, small_light_source)),
            ("distance", offset_of!(InstanceData, distance)),
            ("padding", offset_of!(InstanceData, padding)),
        ],
    );
    assert_layout(
        &module,
        "CapGrid",
        size_of::<CapGridData>(),
        &[
            ("knee", offset_of!(CapGridData, knee)),
            ("points", offset_of!(CapGridData, points)),
            ("slope", offset_of!(CapGridData, slope)),
            ("encoding", offset_of!(CapGridData, encoding)),
            ("inverse_slope", offset_of!(CapGridData, inverse_slope)),
            ("first_texel", offset_of!(CapGridData, first_texel)),
            ("curvature", offset_of!(CapGridData, curvature)),
            ("plane_words", offset_of!(CapGridData, plane_words)),
            ("inverse_extent", offset_of!(CapGridData, inverse_extent)),
            ("padding", offset_of!(CapGridData, padding)),
            ("half_extents", offset_of!(CapGridData, half_extents)),
            ("padding_2", offset_of!(CapGridData, padding_2)),
            ("low", offset_of!(CapGridData, low)),
            ("step", offset_of!(CapGridData, step)),
        ],
    );
    assert_layout(
        &module,
        "Light",
        size_of::<LightData>(),
        &[
            ("origin", offset_of!(LightData, origin)),
            ("kind", offset_of!(LightData, kind)),
            ("tangent", offset_of!(LightData, tangent)),
            ("range", offset_of!(LightData, range)),
            ("bitangent", offset_of!(LightData, bitangent)),
            ("radius", offset_of!(LightData, radius)),
            ("emission", offset_of!(LightData, emission)),
            ("cosine", offset_of!(LightData, cosine)),
        ],
    );
    assert_layout(
        &module,
        "Frame",
        size_of::<FrameUniform>(),
        &[
            ("world_from_clip", offset_of!(FrameUniform, world_from_clip)),
            ("viewport_origin", offset_of!(FrameUniform, viewport_origin)),
            ("viewport_size", offset_of!(FrameUniform, viewport_size)),
            ("trace_size", offset_of!(FrameUniform, trace_size)),
            ("trace_scale", offset_of!(FrameUniform, trace_scale)),
            ("instance_count", offset_of!(FrameUniform, instance_count)),
            ("ambient_rays", offset_of!(FrameUniform, ambient_rays)),
            ("shadow_rays", offset_of!(FrameUniform, shadow_rays)),
            ("light_count", offset_of!(FrameUniform, light_count)),
            ("large_lights", offset_of!(FrameUniform, large_lights)),
            ("max_distance", offset_of!(FrameUniform, max_distance)),
            ("bias_height", offset_of!(FrameUniform, bias_height)),
            ("bias_along", offset_of!(FrameUniform, bias_along)),
            ("falloff", offset_of!(FrameUniform, falloff)),
            ("falloff_tau", offset_of!(FrameUniform, falloff_tau)),
            ("intensity", offset_of!(FrameUniform, intensity)),
            ("traced", offset_of!(FrameUniform, traced)),
            ("screen_space", offset_of!(FrameUniform, screen_space)),
            ("tiles", offset_of!(FrameUniform, tiles)),
            ("list_capacity", offset_of!(FrameUniform, list_capacity)),
            ("page_rows", offset_of!(FrameUniform, page_rows)),
            ("blend", offset_of!(FrameUniform, blend)),
            ("show_tile_load", offset_of!(FrameUniform, show_tile_load)),
            ("lights", offset_of!(FrameUniform, lights)),
        ],
    );
}
