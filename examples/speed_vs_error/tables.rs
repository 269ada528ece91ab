//! The report's tables as files of comma-separated values.

use std::path::Path;

use serde::Serialize;

use super::ReportError;

/// Writes rows under a header of their fields' names.
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
