"""Heights of the road at places near one, in the shapes of Valhalla's and Google's services."""
