// PCL's Euclidean clustering on the candidates that `clustering --out FOLDER` wrote.
//
// Two ways: `extract`, pcl::EuclideanClusterExtraction as its tutorial has it, which clusters all points of a candidate;
// and `seed`, a search tree of PCL's and a flood from the seed alone, which is all that the refiner needs. Building the
// tree is in both: every frame brings other points.
//
// euclidean FOLDER TOLERANCE_M RUNS < "NAME SEED" lines; prints "NAME WAY US MEMBERS SAME" lines, SAME being the share of
// our members and PCL's that both have (intersection over union).

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <vector>

#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Members = std::vector<std::uint32_t>;

template <typename T> std::vector<T> read(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) throw std::runtime_error("cannot read " + path);
  std::vector<T> values(static_cast<std::size_t>(file.tellg()) / sizeof(T));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
  return values;
}

Members extract(const Cloud::Ptr& cloud, std::uint32_t seed, double tolerance_m) {
  auto tree = pcl::make_shared<pcl::search::KdTree<pcl::PointXYZ>>();
  tree->setInputCloud(cloud);
  pcl::EuclideanClusterExtraction<pcl::PointXYZ> clusters;
  clusters.setClusterTolerance(tolerance_m);
  clusters.setMinClusterSize(1);
  clusters.setMaxClusterSize(static_cast<int>(cloud->size()));
  clusters.setSearchMethod(tree);
  clusters.setInputCloud(cloud);
  std::vector<pcl::PointIndices> found;
  clusters.extract(found);
  for (const auto& cluster : found) {
    if (std::find(cluster.indices.begin(), cluster.indices.end(), static_cast<int>(seed)) != cluster.indices.end())
      return Members(cluster.indices.begin(), cluster.indices.end());
  }
  return {};
}

Members flood(const Cloud::Ptr& cloud, std::uint32_t seed, double tolerance_m) {
  pcl::search::KdTree<pcl::PointXYZ> tree(false);
  tree.setInputCloud(cloud);
  std::vector<bool> is_in(cloud->size());
  Members members{seed};
  is_in[seed] = true;
  pcl::Indices near;
  std::vector<float> squared;
  for (std::size_t next = 0; next < members.size(); ++next) {
    tree.radiusSearch((*cloud)[members[next]], tolerance_m, near, squared);
    for (int other : near) {
      if (!is_in[other]) {
        is_in[other] = true;
        members.push_back(static_cast<std::uint32_t>(other));
      }
    }
  }
  return members;
}

double shared(Members a, const Members& b) {
  std::sort(a.begin(), a.end());
  Members both;
  std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
  const auto all = a.size() + b.size() - both.size();
  return all == 0 ? 1.0 : static_cast<double>(both.size()) / static_cast<double>(all);
}

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "euclidean FOLDER TOLERANCE_M RUNS\n";
    return 2;
  }
  const std::string folder = std::string(argv[1]) + "/";
  const double tolerance_m = std::stod(argv[2]);
  const int runs = std::stoi(argv[3]);
  std::string name;
  std::uint32_t seed;
  while (std::cin >> name >> seed) {
    const auto values = read<float>(folder + name + ".f32");
    auto ours = read<std::uint32_t>(folder + name + ".euclidean.u32");
    std::sort(ours.begin(), ours.end());
    const auto cloud = pcl::make_shared<Cloud>();
    for (std::size_t i = 0; i + 2 < values.size(); i += 3)
      cloud->push_back(pcl::PointXYZ(values[i], values[i + 1], values[i + 2]));
    for (const auto& [way, run] : {std::make_pair("extract", &extract), std::make_pair("seed", &flood)}) {
      std::vector<double> times_us;
      Members members;
      for (int k = 0; k <= runs; ++k) {
        const auto start = std::chrono::steady_clock::now();
        members = run(cloud, seed, tolerance_m);
        const std::chrono::duration<double, std::micro> took = std::chrono::steady_clock::now() - start;
        if (k > 0) times_us.push_back(took.count());
      }
      std::sort(times_us.begin(), times_us.end());
      std::cout << name << ' ' << way << ' ' << times_us[times_us.size() / 2] << ' ' << members.size() << ' '
                << shared(members, ours) << '\n';
    }
  }
}
