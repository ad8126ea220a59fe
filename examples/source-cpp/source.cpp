// A source in C++: scans into the pipeline, at about 10 Hz, here from a folder of KITTI's .bin. Yours come from a sensor.
//
//     mluc up --config mluc.toml      # [stages.ingest] command = ["build/source-cpp/source", "DIR"]
//     mluc up --without ingest        # or started by hand: then build/source-cpp/source DIR

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <vector>

#include "mluc.h"

namespace {

constexpr uint32_t kPeriodMs = 100;

std::vector<std::filesystem::path> scans(const char *folder) {
    std::vector<std::filesystem::path> paths;
    for (const auto &entry : std::filesystem::directory_iterator(folder)) {
        if (entry.path().extension() == ".bin") paths.push_back(entry.path());
    }
    std::sort(paths.begin(), paths.end());
    return paths;
}

// x, y, z (m; forward, left, up), intensity (0 to 1).
std::vector<mluc_point> read(const std::filesystem::path &path) {
    std::vector<mluc_point> points(std::filesystem::file_size(path) / sizeof(mluc_point));
    std::ifstream file(path, std::ios::binary);
    file.read(reinterpret_cast<char *>(points.data()), static_cast<std::streamsize>(points.size() * sizeof(mluc_point)));
    points.resize(static_cast<size_t>(file.gcount()) / sizeof(mluc_point));
    return points;
}

int32_t send(mluc_source *source, const std::vector<std::filesystem::path> &paths) {
    int32_t code = MLUC_OK;
    while (code == MLUC_OK || code == MLUC_TIMEOUT) {
        uint64_t number = 0;
        code = mluc_source_wait(source, kPeriodMs, &number);
        if (code != MLUC_OK) continue;
        // The run numbers the scans: a source that was started again after a fault goes on behind its predecessor's.
        if (number >= paths.size()) return mluc_source_finish(source, 5000);
        const auto points = read(paths[number]);
        code = mluc_source_publish(source, points.data(), points.size(), 0, paths[number].stem().c_str());
    }
    return code;
}

}  // namespace

int main(int argc, char **argv) {
    if (argc != 2 || !std::filesystem::is_directory(argv[1])) {
        std::fprintf(stderr, "usage: source DIR, a folder of .bin\n");
        return 2;
    }
    if (mluc_wire_version() != MLUC_WIRE_VERSION) {
        std::fprintf(stderr, "mluc.h is of wire version %u, the library speaks %u\n", MLUC_WIRE_VERSION, mluc_wire_version());
        return 1;
    }
    mluc_source *source = nullptr;
    int32_t code = mluc_source_open(&source);
    if (code == MLUC_OK) code = send(source, scans(argv[1]));
    if (code < 0) std::fprintf(stderr, "source: %s\n", mluc_last_error());
    mluc_source_close(source);
    return code < 0 ? 1 : 0;
}
