"""What several formats are written with: tables, files of OpenStreetMap, slopes to go by, archives."""
