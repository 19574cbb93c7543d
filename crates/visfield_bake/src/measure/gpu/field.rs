//! One field on the adapter: the kernels that ask it, those that tell what limits them, and their twin on the processor.

use bytemuck::{Pod, Zeroable};
use visfield::field::chord::chord;
use visfield::field::lookup::{Aim, TwoPointGrid, forward_lookup, reversed_lookup};
use visfield::field::query::Bias;
use visfield::gpu::layout::encoding_number;
use visfield::gpu::{FIELD_SOURCE, FieldPool, TableSlot};
use visfield::{Ray, VisibilityField};

use super::device::{Gpu, GpuError, Kernel};
use super::rays::MeetingRays;
use super::{GpuField, as_bools, share_of_equal};
use crate::bake::{BakeError, table_of};
use crate::measure::reference::OcclusionError;

/// Bytes that a thread of the gather limit reads, `GATHERS` in `gather.wgsl`.
const GATHERS: usize = 8;

/// What every ray of a list is asked with, `Asked` in `lookup.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Asked {
    first_byte: u32,
    entries: u32,
    exits: u32,
    encoding: u32,
    bias_height: f32,
    bias_along: f32,
    /// Fills 16 bytes.
    padding: [u32; 2],
}

pub(super) struct FieldKernels {
    look_up: Kernel,
    gather: Kernel,
    arithmetic: Kernel,
    ask: Kernel,
    index: Kernel,
    answers: wgpu::Buffer,
    grid: TwoPointGrid,
}

impl FieldKernels {
    /// How many of the kernels are timed.
    pub(super) const TIMED: usize = 4;

    /// Uploads fields into one pool, and prepares what asks each of them.
    pub(super) fn of_all(gpu: &Gpu, fields: &[VisibilityField], rays: &MeetingRays) -> Result<Vec<Self>, GpuError> {
        let list = gpu.buffer("rays in field space", &rays.field_words());
        let normals = gpu.buffer("normals", &rays.normals());
        let mut pool = FieldPool::new(&gpu.device);
        let slots =
            fields.iter().map(|field| pool.insert(&gpu.device, &gpu.queue, field)).collect::<Result<Vec<_>, _>>()?;
        let kernels = |(field, slot): (&VisibilityField, &visfield::gpu::FieldSlot)| {
            let name = || field.header().name.clone();
            let table = slot.table().ok_or_else(|| BakeError::NoTable { name: name() })?;
            Ok(Self::new(gpu, table, [&list, &normals, pool.buffer()], rays.count()))
        };
        fields.iter().zip(&slots).map(kernels).collect()
    }

    fn new(gpu: &Gpu, table: &TableSlot, [list, normals, pool]: [&wgpu::Buffer; 3], rays: usize) -> Self {
        // The place where a byte is read, so that the kernel can leave it out.
        let field = FIELD_SOURCE.replace("fn byte(", "fn fetched_byte(");
        let module = gpu.module("look-ups", &[&field, include_str!("rays.wgsl"), include_str!("lookup.wgsl")]);
        let gather = gpu.module("gathers", &[include_str!("rays.wgsl"), include_str!("gather.wgsl")]);
        let bias = Bias::default();
        let asked = Asked {
            first_byte: table.first_byte,
            entries: table.grid.entries,
            exits: table.grid.exits,
            encoding: encoding_number(table.encoding),
            bias_height: bias.height,
            bias_along: bias.along,
            padding: [0; 2],
        };
        let asked = gpu.buffer("asked", &[asked]);
        let answers = gpu.answers(rays);
        let TwoPointGrid { entries, exits } = table.grid;
        let bytes = (entries * exits).pow(2);
        let range = gpu.buffer("gathered", &[table.first_byte, (1_u32 << bytes.ilog2()) - 1]);
        let kernel = |entry_point, constants: &[(&str, f64)], own: &[(u32, &wgpu::Buffer)]| {
            let buffers = [&[(0, list), (1, &answers), (2, pool), (3, &asked)], own].concat();
            gpu.kernel(entry_point, &module, constants, &buffers, rays)
        };
        let gathered = [(1, &answers), (2, pool), (3, &range)];
        Self {
            look_up: kernel("look_up", &[], &[]),
            gather: gpu.kernel("gather", &gather, &[], &gathered, rays / GATHERS),
            arithmetic: kernel("look_up", &[("FETCH", 0.0)], &[]),
            ask: kernel("ask", &[], &[(4, normals)]),
            index: gpu.kernel("index", &module, &[], &[(0, list), (1, &answers), (3, &asked)], rays),
            answers,
            grid: table.grid,
        }
    }

    /// What is timed: look-ups, gathers, arithmetic, and rays as frames ask them.
    pub(super) fn timed(&self) -> [&Kernel; Self::TIMED] {
        [&self.look_up, &self.gather, &self.arithmetic, &self.ask]
    }

    /// All that there is to say of a field, with the rates of what is timed.
    pub(super) fn measured(
        &self,
        gpu: &Gpu,
        field: &VisibilityField,
        rays: &MeetingRays,
        exact_shares: &[f32],
        rates: &[f64],
        bvh_rays_per_second: f64,
    ) -> Result<GpuField, GpuError> {
        let table = table_of(field)?;
        let answers = as_bools(&gpu.run(&self.ask, &self.answers));
        let error = OcclusionError::of(&rays.shares(&answers), exact_shares);
        let indices: Vec<u32> = gpu.run(&self.index, &self.answers);
        let twin: Vec<u32> = rays.set.field.iter().map(|ray| looked_up_index(self.grid, ray)).collect();
        Ok(GpuField {
            size: table.representation().to_string(),
            field_bytes: table.format().bytes(),
            lookups_per_second: rates[0],
            gather_limit_lookups_per_second: rates[1],
            arithmetic_limit_lookups_per_second: rates[2],
            field_rays_per_second: rates[3],
            speedup_bvh: rates[3] / bvh_rays_per_second,
            index_parity: share_of_equal(&indices, &twin),
            answer_parity: share_of_equal(&answers, &rays.set.field_answers(field)),
            mean_abs: error.mean_abs,
            rms_255: error.rms_255,
        })
    }
}

/// Which byte of a table a ray's answer hangs on: that of the reversed ray for origins inside of the bounds.
fn looked_up_index(grid: TwoPointGrid, ray: &Ray) -> u32 {
    let Ray { origin, direction, .. } = *ray;
    match chord(origin, direction) {
        None => u32::MAX,
        Some(chord) if chord.t_entry() >= 0.0 => forward_lookup(&grid, direction, &chord, Aim::Point).index,
        Some(chord) => reversed_lookup(&grid, origin, direction, &chord, Aim::Point).index,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_read_in_one_place() {
        assert_eq!(FIELD_SOURCE.matches("fn byte(").count(), 1, "the arithmetic limit replaces it");
    }
}
