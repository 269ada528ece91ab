//! Report tables as CSV files.

use std::path::Path;

use serde::Serialize;

use crate::OutputError;

/// Writes a header with the names of the fields, and one line per row.
pub fn write_csv<Row: Serialize>(
    folder: &Path,
    name: &str,
    rows: impl IntoIterator<Item = Row>,
) -> Result<(), OutputError> {
    let path = folder.join(name);
    let failed = |source: csv::Error| OutputError::Csv { path: path.clone(), source };
    let mut writer = csv::Writer::from_path(&path).map_err(failed)?;
    for row in rows {
        writer.serialize(row).map_err(failed)?;
    }
    writer.flush().map_err(|source| OutputError::File { path: path.clone(), source })
}
