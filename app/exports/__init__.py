"""The map as files: every format, where the data of each come from, and exports that the service makes and keeps."""
