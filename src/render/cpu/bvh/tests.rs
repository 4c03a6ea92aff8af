//! Hits against a search through all triangles, on both vector units.
