"""What every subject of the service stands on: settings, database, errors, blobs, HTTP. Knows no subject."""
