//! Typed, checked access to the numbers of a buffer view (glTF 2.0, 3.6.2).

use super::data::{Data, missing, slice};
use crate::scene::SceneError;

/// Type of one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// What an element is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    pub component: Component,
    /// Numbers per column: 1 to 4.
    pub rows: usize,
    /// 1; of a matrix 2 to 4.
    pub columns: usize,
    pub normalized: bool,
}

impl Format {
    /// Bytes of an element; columns of matrices begin at multiples of four bytes (3.6.2.4).
    fn size(self) -> u64 {
        let column = self.component.size() * self.rows as u64;
        if self.columns == 1 { column } else { column.next_multiple_of(4) * self.columns as u64 }
    }
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let normalized = if self.normalized { " normalized" } else { "" };
        match (self.columns, self.rows) {
            (1, 1) => write!(f, "SCALAR {:?}{normalized}", self.component),
            (1, rows) => write!(f, "VEC{rows} {:?}{normalized}", self.component),
            (columns, _) => write!(f, "MAT{columns} {:?}{normalized}", self.component),
        }
    }
}

/// An accessor that has been checked to lie within its data.
pub(super) struct Accessor<'a> {
    /// Place in the file.
    pub pointer: String,
    pub format: Format,
    pub count: usize,
    /// From the first element on; none: all zero.
    base: Option<&'a [u8]>,
    stride: usize,
    sparse: Option<Sparse<'a>>,
}

struct Sparse<'a> {
    indices: &'a [u8],
    component: Component,
    values: &'a [u8],
    count: usize,
}

/// Opens accessor `index` after checking all that can be checked without reading its data.
pub(super) fn open<'a>(data: &'a Data<'_>, index: usize) -> Result<Accessor<'a>, SceneError> {
    let pointer = format!("/accessors/{index}");
    let source = data.root.accessors.get(index).ok_or_else(|| missing(&pointer, "accessor", index))?;
    let component = component_type(source.component_type, &format!("{pointer}/componentType"))?;
    let (rows, columns) = shape(&source.kind, &pointer)?;
    let format = Format { component, rows, columns, normalized: source.normalized };
    let count = usize::try_from(source.count).ok().filter(|count| *count <= u32::MAX as usize).ok_or_else(|| {
        let detail = format!("{} elements are more than the {} that can be counted", source.count, u32::MAX);
        SceneError::invalid("accessor_out_of_bounds", format!("{pointer}/count"), detail)
    })?;
    let mut accessor = Accessor { pointer, format, count, base: None, stride: format.size() as usize, sparse: None };
    if let Some(elements) = data.decoded(index) {
        accessor.base = Some(elements);
    } else if let Some(view) = source.buffer_view {
        accessor.place(data, view, source.byte_offset)?;
    }
    if let Some(sparse) = &source.sparse {
        accessor.sparse = Some(accessor.open_sparse(data, sparse)?);
    }
    Ok(accessor)
}

fn component_type(code: u64, pointer: &str) -> Result<Component, SceneError> {
    Component::of(code).ok_or_else(|| {
        let detail = format!("{code} is not a component type; it is one of 5120, 5121, 5122, 5123, 5125, 5126");
        SceneError::invalid("accessor_type", pointer, detail)
    })
}

fn shape(kind: &str, pointer: &str) -> Result<(usize, usize), SceneError> {
    Ok(match kind {
        "SCALAR" => (1, 1),
        "VEC2" => (2, 1),
        "VEC3" => (3, 1),
        "VEC4" => (4, 1),
        "MAT2" => (2, 2),
        "MAT3" => (3, 3),
        "MAT4" => (4, 4),
        other => {
            let detail = format!("`{other}` is not an accessor type; it is SCALAR, VEC2 to VEC4 or MAT2 to MAT4");
            return Err(SceneError::invalid("accessor_type", format!("{pointer}/type"), detail));
        }
    })
}

impl<'a> Accessor<'a> {
    /// Finds the elements in buffer view `view`.
    fn place(&mut self, data: &'a Data<'_>, view: usize, offset: u64) -> Result<(), SceneError> {
        let bytes = data.view(view)?;
        let source = data.root.buffer_views.get(view);
        let view_offset = source.map_or(0, |source| source.byte_offset);
        let element = self.format.size();
        let unit = if self.format.columns > 1 { 4 } else { self.format.component.size() };
        let stride = source.and_then(|source| source.byte_stride).unwrap_or(element);
        if stride < element || !stride.is_multiple_of(self.format.component.size()) || stride > 255 {
            let detail = format!(
                "byteStride {stride} does not suit elements of {element} bytes ({}) of {}",
                self.format, self.pointer
            );
            return Err(SceneError::invalid("buffer_view_stride", format!("/bufferViews/{view}/byteStride"), detail));
        }
        if !offset.is_multiple_of(unit) || !view_offset.wrapping_add(offset).is_multiple_of(unit) {
            let detail =
                format!("byte {offset} of a view at byte {view_offset} is not a multiple of {unit} ({})", self.format);
            return Err(SceneError::invalid("accessor_alignment", format!("{}/byteOffset", self.pointer), detail));
        }
        let length = match self.count as u64 {
            0 => 0,
            count => stride * (count - 1) + element,
        };
        self.base = Some(slice(bytes, offset, length).ok_or_else(|| {
            let detail = format!(
                "{} elements of {element} bytes, {stride} apart, from byte {offset} do not fit in buffer view {view} of {} bytes",
                self.count,
                bytes.len()
            );
            SceneError::invalid("accessor_out_of_bounds", self.pointer.clone(), detail)
        })?);
        self.stride = stride as usize;
        Ok(())
    }

    fn open_sparse(&self, data: &'a Data<'_>, source: &super::schema::Sparse) -> Result<Sparse<'a>, SceneError> {
        let pointer = format!("{}/sparse", self.pointer);
        let count = usize::try_from(source.count).ok().filter(|count| *count <= self.count).ok_or_else(|| {
            let detail = format!("{} elements are replaced, but the accessor has only {}", source.count, self.count);
            SceneError::invalid("accessor_sparse", format!("{pointer}/count"), detail)
        })?;
        let component = component_type(source.indices.component_type, &format!("{pointer}/indices/componentType"))?;
        if !matches!(component, Component::U8 | Component::U16 | Component::U32) {
            let detail = "sparse indices are unsigned integers (5121, 5123 or 5125)";
            return Err(SceneError::invalid("accessor_sparse", format!("{pointer}/indices/componentType"), detail));
        }
        let part = |name: &str, view: usize, offset: u64, unit: u64, size: u64| {
            let place = format!("{pointer}/{name}");
            if !offset.is_multiple_of(unit) {
                let detail = format!("byte {offset} is not a multiple of {unit}");
                return Err(SceneError::invalid("accessor_alignment", format!("{place}/byteOffset"), detail));
            }
            let view = data.view(view).map_err(|error| SceneError { pointer: place.clone(), ..error })?;
            slice(view, offset, size * count as u64).ok_or_else(|| {
                let detail = format!(
                    "{count} elements of {size} bytes at byte {offset} do not fit in a view of {} bytes",
                    view.len()
                );
                SceneError::invalid("accessor_out_of_bounds", place, detail)
            })
        };
        let (indices, values) = (&source.indices, &source.values);
        Ok(Sparse {
            indices: part("indices", indices.buffer_view, indices.byte_offset, component.size(), component.size())?,
            component,
            values: part(
                "values",
                values.buffer_view,
                values.byte_offset,
                self.format.component.size(),
                self.format.size(),
            )?,
            count,
        })
    }

    /// The elements `selection` (all if none), which must be below `count`, as numbers (of matrices only those of four
    /// bytes, column by column); components beyond those stored are `fill`. Integers are mapped to 0..1 or -1..1 if normalised (3.6.2.2).
    pub(super) fn numbers<const N: usize>(
        &self,
        selection: Option<&[u32]>,
        fill: f32,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        if let (Some(selection), Some(_)) = (selection, &self.sparse) {
            let all = self.numbers::<N>(None, fill)?;
            return Ok(selection.iter().map(|index| all.get(*index as usize).copied().unwrap_or([fill; N])).collect());
        }
        let convert = converter(self.format.component, self.format.normalized);
        let size = self.format.component.size() as usize;
        let decode = |bytes: &[u8]| {
            let mut element = [fill; N];
            for (value, number) in
                element.iter_mut().zip(bytes.chunks_exact(size).take(self.format.rows * self.format.columns))
            {
                *value = convert(number);
            }
            element
        };
        let zero = vec![0; self.format.size() as usize];
        let at = |index: usize| decode(self.element(index).unwrap_or(&zero));
        let mut elements: Vec<[f32; N]> = match selection {
            Some(selection) => selection.iter().map(|index| at(*index as usize)).collect(),
            None => (0..self.count).map(at).collect(),
        };
        self.replace(|index, bytes| {
            if let Some(element) = elements.get_mut(index) {
                *element = decode(bytes);
            }
        })?;
        Ok(elements)
    }

    /// Unsigned integers (indices).
    pub(super) fn integers(&self) -> Result<Vec<u32>, SceneError> {
        let zero = vec![0; self.format.size() as usize];
        let at = |index| integer(self.element(index).unwrap_or(&zero), self.format.component);
        let mut elements: Vec<u32> = (0..self.count).map(at).collect();
        self.replace(|index, bytes| {
            if let Some(element) = elements.get_mut(index) {
                *element = integer(bytes, self.format.component);
            }
        })?;
        Ok(elements)
    }

    /// Whether elements lie in a buffer, rather than being zero but for the sparse ones.
    pub(super) fn is_stored(&self) -> bool {
        self.base.is_some()
    }

    /// Whether some elements are replaced.
    pub(super) fn is_sparse(&self) -> bool {
        self.sparse.is_some()
    }

    fn element(&self, index: usize) -> Option<&'a [u8]> {
        let start = index.checked_mul(self.stride)?;
        self.base?.get(start..start.checked_add(self.format.size() as usize)?)
    }

    /// Calls `set` for each element that the sparse part replaces.
    fn replace(&self, mut set: impl FnMut(usize, &[u8])) -> Result<(), SceneError> {
        let Some(sparse) = &self.sparse else { return Ok(()) };
        let values = sparse.values.chunks_exact(self.format.size() as usize);
        let indices = sparse.indices.chunks_exact(sparse.component.size() as usize);
        let mut next = 0;
        for (index, value) in
            indices.map(|bytes| integer(bytes, sparse.component) as usize).zip(values).take(sparse.count)
        {
            if index < next || index >= self.count {
                let detail =
                    format!("index {index} must be greater than the one before it and less than {}", self.count);
                return Err(SceneError::invalid("accessor_sparse", format!("{}/sparse/indices", self.pointer), detail));
            }
            next = index + 1;
            set(index, value);
        }
        Ok(())
    }
}

/// Little-endian bytes of one number as an unsigned integer.
fn integer(bytes: &[u8], component: Component) -> u32 {
    match (component, bytes) {
        (Component::U8, [a, ..]) => u32::from(*a),
        (Component::U16, [a, b, ..]) => u32::from(u16::from_le_bytes([*a, *b])),
        (_, [a, b, c, d, ..]) => u32::from_le_bytes([*a, *b, *c, *d]),
        _ => 0,
    }
}

fn converter(component: Component, normalized: bool) -> fn(&[u8]) -> f32 {
    fn i8(bytes: &[u8]) -> f32 {
        bytes.first().map_or(0.0, |byte| f32::from(byte.cast_signed()))
    }
    fn u8(bytes: &[u8]) -> f32 {
        integer(bytes, Component::U8) as f32
    }
    fn i16(bytes: &[u8]) -> f32 {
        (integer(bytes, Component::U16) as u16).cast_signed().into()
    }
    fn u16(bytes: &[u8]) -> f32 {
        integer(bytes, Component::U16) as f32
    }
    match (component, normalized) {
        (Component::I8, false) => i8,
        (Component::I8, true) => |bytes| (i8(bytes) / 127.0).max(-1.0),
        (Component::U8, false) => u8,
        (Component::U8, true) => |bytes| u8(bytes) / 255.0,
        (Component::I16, false) => i16,
        (Component::I16, true) => |bytes| (i16(bytes) / 32767.0).max(-1.0),
        (Component::U16, false) => u16,
        (Component::U16, true) => |bytes| u16(bytes) / 65535.0,
        (Component::U32, _) => |bytes| integer(bytes, Component::U32) as f32,
        (Component::F32, _) => |bytes| f32::from_bits(integer(bytes, Component::F32)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::import::testing::Builder;
    use serde_json::{Value, json};

    fn numbers<const N: usize>(
        bytes: &[u8],
        accessor: &Value,
        stride: Option<u64>,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let mut builder = Builder::default();
        let view = builder.view(bytes);
        if let Some(stride) = stride {
            builder.json["bufferViews"][view]["byteStride"] = json!(stride);
        }
        builder.json["accessors"] = json!([accessor]);
        builder.with_data(|data| open(data, 0)?.numbers(None, 0.0))
    }

    #[test]
    fn integers_are_normalised_as_the_specification_says() {
        let of = |code: u32, normalized| json!({"bufferView": 0, "componentType": code, "normalized": normalized, "count": 2, "type": "SCALAR"});
        assert_eq!(numbers(&[0x80, 127], &of(5120, true), None).unwrap(), [[-1.0], [1.0]]);
        assert_eq!(numbers(&[0x80, 127], &of(5120, false), None).unwrap(), [[-128.0], [127.0]]);
        assert_eq!(numbers(&[51, 255], &of(5121, true), None).unwrap(), [[0.2], [1.0]]);
        assert_eq!(numbers(&[0, 0x80, 0xff, 0x7f], &of(5122, true), None).unwrap(), [[-1.0], [1.0]]);
        assert_eq!(numbers(&[0x33, 0x33, 0xff, 0xff], &of(5123, true), None).unwrap(), [[0.2], [1.0]]);
        assert_eq!(numbers(&[1, 0, 0, 1], &of(5123, false), None).unwrap(), [[1.0], [256.0]]);
    }

    #[test]
    fn strides_skip_what_lies_between() {
        let accessor = json!({"bufferView": 0, "byteOffset": 1, "componentType": 5121, "count": 2, "type": "VEC2"});
        assert_eq!(numbers(&[9, 1, 2, 9, 9, 3, 4], &accessor, Some(4)).unwrap(), [[1.0, 2.0], [3.0, 4.0]]);
    }

    #[test]
    fn accessors_must_fit() {
        let code = |accessor, stride| {
            let fault = numbers::<1>(&[0; 8], &accessor, stride).unwrap_err();
            (fault.code, fault.pointer)
        };
        let of = |code: u32, offset: u64, count: u64, kind: &str| json!({"bufferView": 0, "byteOffset": offset, "componentType": code, "count": count, "type": kind});
        assert_eq!(code(of(5126, 0, 3, "SCALAR"), None), ("accessor_out_of_bounds", "/accessors/0".into()));
        assert_eq!(
            code(of(5126, 0, u64::MAX, "SCALAR"), None),
            ("accessor_out_of_bounds", "/accessors/0/count".into())
        );
        assert_eq!(code(of(5126, u64::MAX - 3, 1, "SCALAR"), None), ("accessor_out_of_bounds", "/accessors/0".into()));
        assert_eq!(code(of(5126, 2, 1, "SCALAR"), None), ("accessor_alignment", "/accessors/0/byteOffset".into()));
        assert_eq!(code(of(5120, 2, 1, "MAT2"), None), ("accessor_alignment", "/accessors/0/byteOffset".into()));
        assert_eq!(code(of(5126, 0, 1, "VEC2"), Some(4)), ("buffer_view_stride", "/bufferViews/0/byteStride".into()));
        assert_eq!(code(of(5124, 0, 1, "SCALAR"), None), ("accessor_type", "/accessors/0/componentType".into()));
        assert_eq!(code(of(5126, 0, 1, "VEC5"), None), ("accessor_type", "/accessors/0/type".into()));
    }

    #[test]
    fn sparse_values_replace_base_or_zero() {
        let sparse = |count: u64, indices: &[u8], base: Option<usize>| {
            let mut builder = Builder::default();
            builder.view(&[10, 11, 12, 13]);
            builder.view(indices);
            builder.view(&[7, 8]);
            builder.json["accessors"] = json!([{"bufferView": base, "componentType": 5121, "count": 4, "type": "SCALAR",
                "sparse": {"count": count, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 2}}}]);
            builder.with_data(|data| {
                let accessor = open(data, 0)?;
                assert_eq!(
                    accessor.integers().map_err(|error| error.pointer),
                    accessor
                        .numbers::<1>(None, 0.0)
                        .map(|all| all.iter().map(|[x]| *x as u32).collect())
                        .map_err(|error| error.pointer)
                );
                Ok((accessor.numbers::<1>(None, 0.0)?.concat(), accessor.numbers::<1>(Some(&[3, 0]), 0.0)?.concat()))
            })
        };
        assert_eq!(sparse(2, &[1, 3], Some(0)).unwrap(), (vec![10.0, 7.0, 12.0, 8.0], vec![8.0, 10.0]));
        assert_eq!(sparse(2, &[0, 2], None).unwrap().0, [7.0, 0.0, 8.0, 0.0]);
        assert_eq!(sparse(2, &[3, 1], Some(0)).unwrap_err().pointer, "/accessors/0/sparse/indices", "order");
        assert_eq!(sparse(2, &[1, 4], Some(0)).unwrap_err().pointer, "/accessors/0/sparse/indices", "range");
        assert_eq!(sparse(5, &[1, 2], Some(0)).unwrap_err().pointer, "/accessors/0/sparse/count");
        assert_eq!(sparse(2, &[1], Some(0)).unwrap_err().pointer, "/accessors/0/sparse/indices", "too short");
    }
}
