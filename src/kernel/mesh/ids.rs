//! Typed indices: the type says which array a number points into.

/// Declares a newtype over `u32` that indexes one kind of mesh element.
macro_rules! element_id {
    ($(#[$documentation:meta])* $name:ident) => {
        $(#[$documentation])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub struct $name(pub u32);

        impl $name {
            /// The element's index in its array.
            #[must_use]
            pub const fn index(self) -> usize {
                self.0 as usize
            }
        }
    };
}

element_id! {
    /// A triangle of one surface: its index in the caller's triangle list.
    TriangleId
}
element_id! {
    /// A vertex of one surface: its index in the caller's position list, never a welded number.
    VertexId
}
element_id! {
    /// An edge of one surface: its index among the unique welded edges, which are sorted by their vertices.
    EdgeId
}
element_id! {
    /// A tetrahedron of one body: its index in the caller's list of tetrahedra.
    TetrahedronId
}
