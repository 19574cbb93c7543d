//! The triangles on the adapter, and the kernel that traces rays through them.

use super::device::{Gpu, Kernel};
use super::rays::RayWords;
use crate::exact::ExactScene;

/// A compressed wide BVH in buffers.
pub(in crate::measure) struct Bvh {
    nodes: wgpu::Buffer,
    triangles: wgpu::Buffer,
    module: wgpu::ShaderModule,
}

/// A list of rays, ready to be traced.
pub(in crate::measure) struct Trace {
    pub(in crate::measure) kernel: Kernel,
    /// 1 for each ray that hits anything, else 0.
    pub(in crate::measure) answers: wgpu::Buffer,
}

impl Bvh {
    pub(in crate::measure) fn new(gpu: &Gpu, scene: &ExactScene) -> Self {
        let words = scene.triangles().words();
        Self {
            nodes: gpu.buffer("nodes of the BVH", &words.nodes),
            triangles: gpu.buffer("triangles of the BVH", &words.triangles),
            module: gpu.module("BVH", &[include_str!("rays.wgsl"), include_str!("cwbvh.wgsl")]),
        }
    }

    /// Bytes of nodes and triangles.
    pub(in crate::measure) fn bytes(&self) -> u64 {
        self.nodes.size() + self.triangles.size()
    }

    pub(in crate::measure) fn trace(&self, gpu: &Gpu, rays: &[RayWords]) -> Trace {
        let list = gpu.buffer("rays in the space of the triangles", rays);
        let answers = gpu.answers(rays.len());
        let buffers = [(0, &list), (1, &answers), (2, &self.nodes), (3, &self.triangles)];
        let kernel = gpu.kernel("trace", &self.module, &[], &buffers, rays.len());
        Trace { kernel, answers }
    }
}
