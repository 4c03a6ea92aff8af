//! What has been uploaded: scenes, environments and tables, kept as long as their source lives.

use super::device::Gpu;
use super::{profiles, records};
use crate::compile::{CompiledScene, Environment, EnvironmentKind, FACING_STRIDE, Hdri, Share, TexturePages};
use crate::render::RenderError;
use crate::render::albedo::{TABLE_WIDTH, albedo_table};
use crate::render::layer_albedo::LAYER_TABLE;
use crate::scene::Profile;
use std::sync::{Arc, Weak};
use wgpu::util::{DeviceExt, TextureDataOrder};

/// Texels in a row of records, as in `shaders/lib/bindings.wesl`.
const ROW: usize = 8192;

/// Bytes of a texel of records.
const TEXEL: usize = 16;

/// Buffers and textures of a [`CompiledScene`].
pub struct GpuScene {
    /// Binding 2.
    pub nodes: wgpu::TextureView,
    /// Binding 3.
    pub triangles: wgpu::TextureView,
    /// Binding 4.
    pub records: wgpu::TextureView,
    /// Binding 5.
    pub light_nodes: wgpu::TextureView,
    /// Binding 10.
    pub color_pages: wgpu::TextureView,
    /// Binding 11.
    pub data_pages: wgpu::TextureView,
}

/// Textures of an environment.
pub struct GpuEnvironment {
    /// Binding 12.
    pub texels: wgpu::TextureView,
    /// Binding 13.
    pub cells: wgpu::TextureView,
    /// Binding 6.
    pub tiles: wgpu::TextureView,
}

/// Uploads by source. A source that nobody else holds any more is dropped at the next render.
pub struct Resources {
    /// Tables of the core's lobes.
    core_albedo: wgpu::TextureView,
    /// The same with those of layers below, once a scene has asked for them.
    all_albedo: Option<wgpu::TextureView>,
    scenes: Vec<(Weak<CompiledScene>, Arc<GpuScene>)>,
    environments: Vec<(Weak<Hdri>, Arc<GpuEnvironment>)>,
    no_environment: Arc<GpuEnvironment>,
}

impl Resources {
    /// The tables that every render reads.
    pub fn new(gpu: &Gpu) -> Self {
        let core_albedo = upload_albedo(gpu, &albedo_table().texels);
        let no_environment = Arc::new(GpuEnvironment {
            texels: texture(gpu, "no environment", (1, 1, 1), wgpu::TextureFormat::Rgba32Float, &[0; 16]),
            cells: texture(gpu, "no environment", (1, 1, 1), wgpu::TextureFormat::Rg32Float, &[0; 8]),
            tiles: texture(gpu, "no environment", (1, 1, 1), wgpu::TextureFormat::Rg32Float, &[0; 8]),
        });
        Self { core_albedo, all_albedo: None, scenes: Vec::new(), environments: Vec::new(), no_environment }
    }

    /// Binding 14: what a scene's materials read.
    pub fn albedo(&mut self, gpu: &Gpu, scene: &CompiledScene) -> wgpu::TextureView {
        if scene.extended.is_empty() {
            return self.core_albedo.clone();
        }
        let all = self.all_albedo.get_or_insert_with(|| {
            let layers = LAYER_TABLE.iter().map(|albedo| [*albedo, 0.0]);
            upload_albedo(gpu, &albedo_table().texels.iter().copied().chain(layers).collect::<Vec<_>>())
        });
        all.clone()
    }

    /// The scene on the device.
    pub fn scene(&mut self, gpu: &Gpu, scene: &Arc<CompiledScene>) -> Result<Arc<GpuScene>, RenderError> {
        find_or_upload(&mut self.scenes, scene, |scene| upload_scene(gpu, scene))
    }

    /// The environment on the device.
    pub fn environment(&mut self, gpu: &Gpu, environment: &Environment) -> Result<Arc<GpuEnvironment>, RenderError> {
        match &environment.kind {
            EnvironmentKind::Hdri(hdri) => {
                find_or_upload(&mut self.environments, hdri, |hdri| upload_environment(gpu, hdri))
            }
            _ => Ok(Arc::clone(&self.no_environment)),
        }
    }
}

/// Binding 17: what a request's lights were measured to send.
pub(in crate::render) fn upload_profiles(gpu: &Gpu, list: &[Profile]) -> Result<wgpu::TextureView, RenderError> {
    let words = profiles::words(list);
    upload_records(gpu, "light profiles", bytemuck::cast_slice(&words), wgpu::TextureUsages::TEXTURE_BINDING)
}

/// Rows of [`TABLE_WIDTH`] entries.
fn upload_albedo(gpu: &Gpu, texels: &[[f32; 2]]) -> wgpu::TextureView {
    let size = (TABLE_WIDTH, texels.len() as u32 / TABLE_WIDTH, 1);
    texture(gpu, "albedo tables", size, wgpu::TextureFormat::Rg32Float, bytemuck::cast_slice(texels))
}

fn find_or_upload<S, T>(
    held: &mut Vec<(Weak<S>, Arc<T>)>,
    source: &Arc<S>,
    upload: impl FnOnce(&S) -> Result<T, RenderError>,
) -> Result<Arc<T>, RenderError> {
    held.retain(|(weak, _)| weak.strong_count() > 0);
    if let Some((_, found)) = held.iter().find(|(weak, _)| std::ptr::eq(weak.as_ptr(), Arc::as_ptr(source))) {
        return Ok(Arc::clone(found));
    }
    let uploaded = Arc::new(upload(source)?);
    held.push((Arc::downgrade(source), Arc::clone(&uploaded)));
    Ok(uploaded)
}

fn upload_scene(gpu: &Gpu, scene: &CompiledScene) -> Result<GpuScene, RenderError> {
    let (stored, sampled) = (wgpu::TextureUsages::STORAGE_BINDING, wgpu::TextureUsages::TEXTURE_BINDING);
    Ok(GpuScene {
        nodes: upload_records(gpu, "tree nodes", bytemuck::cast_slice(&scene.nodes), stored)?,
        triangles: upload_records(gpu, "triangles", bytemuck::cast_slice(&scene.triangles), stored)?,
        records: upload_records(gpu, "vertices", bytemuck::cast_slice(&records::words(scene)), stored)?,
        light_nodes: upload_records(gpu, "light tree", bytemuck::cast_slice(&scene.light_tree.nodes), sampled)?,
        color_pages: upload_pages(gpu, &scene.color_pages, wgpu::TextureFormat::Rgba8UnormSrgb)?,
        data_pages: upload_pages(gpu, &scene.data_pages, wgpu::TextureFormat::Rgba8Unorm)?,
    })
}

/// Records of whole texels, in rows of [`ROW`]. What a ray reads at every step lies in storage textures: a software
/// device reads their texels faster than vectors of a buffer (docs/benchmarks.md), and they hold more than one binding of
/// a buffer may.
fn upload_records(
    gpu: &Gpu,
    label: &str,
    bytes: &[u8],
    usage: wgpu::TextureUsages,
) -> Result<wgpu::TextureView, RenderError> {
    let texels = bytes.len().div_ceil(TEXEL).max(1);
    let (width, height) = (texels.min(ROW), texels.div_ceil(ROW));
    let limit = gpu.device.limits().max_texture_dimension_2d as usize;
    if height > limit {
        return Err(RenderError::TooLarge(format!(
            "{label} take {} MiB, a texture of {} holds {} MiB; use fewer triangles",
            bytes.len() >> 20,
            gpu.info.name,
            (ROW * limit * TEXEL) >> 20
        )));
    }
    let mut rows = bytes.to_vec();
    rows.resize(width * height * TEXEL, 0);
    let (size, format) = ((width as u32, height as u32, 1), wgpu::TextureFormat::Rgba32Uint);
    let texture = create_texture(gpu, label, size, format, usage, &rows);
    Ok(texture.create_view(&wgpu::TextureViewDescriptor::default()))
}

fn upload_pages(
    gpu: &Gpu,
    pages: &TexturePages,
    format: wgpu::TextureFormat,
) -> Result<wgpu::TextureView, RenderError> {
    let limits = gpu.device.limits();
    let (side, layers) = (pages.page_size.max(1), pages.pages.len().max(1) as u32);
    if side > limits.max_texture_dimension_2d || layers > limits.max_texture_array_layers {
        return Err(RenderError::TooLarge(format!(
            "{layers} texture pages of {side} x {side}; {} takes {} of {}; use fewer or smaller textures",
            gpu.info.name, limits.max_texture_array_layers, limits.max_texture_dimension_2d
        )));
    }
    let mut bytes = pages.pages.concat();
    bytes.resize((side * side * 4) as usize * layers as usize, 0);
    let texture = create_texture(
        gpu,
        "texture pages",
        (side, side, layers),
        format,
        wgpu::TextureUsages::TEXTURE_BINDING,
        &bytes,
    );
    let dimension = Some(wgpu::TextureViewDimension::D2Array);
    Ok(texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() }))
}

fn upload_environment(gpu: &Gpu, hdri: &Hdri) -> Result<GpuEnvironment, RenderError> {
    let limit = gpu.device.limits().max_texture_dimension_2d;
    if hdri.width > limit || hdri.height >= limit {
        return Err(RenderError::TooLarge(format!(
            "the environment has {} x {} texels, {} takes {limit} a side",
            hdri.width, hdri.height, gpu.info.name
        )));
    }
    let texels: Vec<[f32; 4]> = hdri.texels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let size = (hdri.width, hdri.height, 1);
    let cells = bytemuck::cast_slice(&hdri.cells);
    let cells_size = (hdri.width, hdri.height + 1, 1);
    let (tiles, tiles_size) = tile_tables(hdri);
    Ok(GpuEnvironment {
        texels: texture(gpu, "environment", size, wgpu::TextureFormat::Rgba32Float, bytemuck::cast_slice(&texels)),
        cells: texture(gpu, "environment", cells_size, wgpu::TextureFormat::Rg32Float, cells),
        tiles: texture(gpu, "environment", tiles_size, wgpu::TextureFormat::Rg32Float, bytemuck::cast_slice(&tiles)),
    })
}

/// The facings' tables and below them the rows of the columns of tiles, each a row of a texture; and its size.
fn tile_tables(hdri: &Hdri) -> (Vec<Share>, (u32, u32, u32)) {
    let rows = hdri.height as usize + 1;
    let width = FACING_STRIDE.max(rows);
    let padded = |line: Vec<Share>| line.into_iter().chain(std::iter::repeat(Share::default())).take(width);
    let facings = hdri.tiles.chunks_exact(FACING_STRIDE).map(<[Share]>::to_vec);
    let of_row = |&cumulative: &f32| Share { cumulative, probability: 0.0 };
    let columns = hdri.rows.chunks_exact(rows).map(|column| column.iter().map(of_row).collect());
    let table: Vec<Share> = facings.chain(columns).flat_map(padded).collect();
    let height = table.len() / width;
    (table, (width as u32, height as u32, 1))
}

pub(in crate::render) fn texture(
    gpu: &Gpu,
    label: &str,
    size: (u32, u32, u32),
    format: wgpu::TextureFormat,
    bytes: &[u8],
) -> wgpu::TextureView {
    create_texture(gpu, label, size, format, wgpu::TextureUsages::TEXTURE_BINDING, bytes)
        .create_view(&wgpu::TextureViewDescriptor::default())
}

fn create_texture(
    gpu: &Gpu,
    label: &str,
    (width, height, depth_or_array_layers): (u32, u32, u32),
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
    bytes: &[u8],
) -> wgpu::Texture {
    gpu.device.create_texture_with_data(
        &gpu.queue,
        &wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        },
        TextureDataOrder::LayerMajor,
        bytes,
    )
}
