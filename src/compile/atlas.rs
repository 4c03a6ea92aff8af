//! Packs rectangles into square pages, on shelves.

/// Where a rectangle lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Place {
    /// Page.
    pub page: u32,
    /// Left.
    pub x: u32,
    /// Top.
    pub y: u32,
}

/// Places rectangles of (width, height), none larger than the page, tallest first. Returns their places in the order
/// given, and the number of pages.
pub fn pack(sizes: &[(u32, u32)], page_size: u32) -> (Vec<Place>, u32) {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|i| (std::cmp::Reverse(sizes[*i].1), std::cmp::Reverse(sizes[*i].0), *i));
    let mut places = vec![Place::default(); sizes.len()];
    let mut shelves: Vec<Shelf> = Vec::new();
    let mut filled: Vec<u32> = Vec::new();
    for i in order {
        let (width, height) = sizes[i];
        let found = shelves.iter().position(|shelf| shelf.height >= height && page_size - shelf.used >= width);
        let index = found.unwrap_or_else(|| {
            shelves.push(Shelf::new(&mut filled, page_size, height));
            shelves.len() - 1
        });
        let shelf = &mut shelves[index];
        places[i] = Place { page: shelf.page, x: shelf.used, y: shelf.y };
        shelf.used += width;
    }
    (places, filled.len() as u32)
}

/// A row of rectangles.
struct Shelf {
    page: u32,
    y: u32,
    height: u32,
    used: u32,
}

impl Shelf {
    /// Opens a shelf on the first page with room; `filled` is the height taken on each page.
    fn new(filled: &mut Vec<u32>, page_size: u32, height: u32) -> Self {
        let page = filled.iter().position(|y| page_size - y >= height).unwrap_or_else(|| {
            filled.push(0);
            filled.len() - 1
        });
        let y = filled[page];
        filled[page] += height;
        Self { page: page as u32, y, height, used: 0 }
    }
}
