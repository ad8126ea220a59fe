//! mluc-refiner
