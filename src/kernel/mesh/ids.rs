//! Indices with a meaning: which array a number points into is part of its type.

/// Declares a newtype over `u32` that indexes one kind of mesh element.
macro_rules! element_id {
    ($(#[$documentation:meta])* $name:ident) => {
        $(#[$documentation])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);

        impl $name {
            /// The element's place in its array.
            #[must_use]
            pub const fn index(self) -> usize {
                self.0 as usize
            }
        }
    };
}

element_id! {
    /// A triangle of one surface: its place in the triangle list that the caller gave.
    TriangleId
}
element_id! {
    /// A vertex of one surface: its place in the position list that the caller gave, never a welded number.
    VertexId
}
element_id! {
    /// An edge of one surface: its place among the unique welded edges, sorted by their vertices.
    EdgeId
}
