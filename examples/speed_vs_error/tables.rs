//! The tables of the report as CSV files.

use std::path::Path;

use serde::Serialize;

use super::ReportError;

/// Writes rows below a header with the names of their fields.
pub fn write_csv<Row: Serialize>(
    folder: &Path,
    name: &str,
    rows: impl IntoIterator<Item = Row>,
) -> Result<(), ReportError> {
    let path = folder.join(name);
    let failed = |source: csv::Error| ReportError::Csv { path: path.clone(), source };
    let mut writer = csv::Writer::from_path(&path).map_err(failed)?;
    for row in rows {
        writer.serialize(row).map_err(failed)?;
    }
    writer.flush().map_err(|source| ReportError::Write { path: path.clone(), source })
}
