"""Methods ``gps-ins-kf``, ``gps-ins-ekf``, ``gps-ins-ukf``: Saadaoui 2011."""
