//! Text -> [`RenderParams`].
