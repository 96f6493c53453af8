// A stand-in for as much of Unreal as examples/receivers/FapengineFace.cpp uses; it shows that the code is C++ and what it
// does with frames, not that Unreal's headers are so.
#pragma once
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#define TEXT(x) x
#define UCLASS(...)
#define UPROPERTY(...)
#define GENERATED_BODY() using Super = UActorComponent;
using int32 = int;
struct ESearchCase { enum Type { CaseSensitive, IgnoreCase }; };
struct ESearchDir { enum Type { FromStart, FromEnd }; };

struct FString {
    std::string s;
    FString(const char* x = "") : s(x) {}
    FString(const std::string& x) : s(x) {}
    bool IsEmpty() const { return s.empty(); }
    void Empty() { s.clear(); }
    bool EndsWith(const char* x, ESearchCase::Type) const
    { std::string e(x); return s.size() >= e.size() && s.compare(s.size() - e.size(), e.size(), e) == 0; }
    FString LeftChop(int n) const { return FString(s.substr(0, s.size() - n)); }
    FString ToLower() const { std::string r; for (char c : s) r += static_cast<char>(tolower(c)); return r; }
    FString Replace(const char* from, const char* to) const
    { std::string r = s, f(from); for (size_t at; (at = r.find(f)) != std::string::npos;) r.replace(at, f.size(), to); return r; }
    bool Split(const FString& mark, FString* left, FString* right, ESearchCase::Type, ESearchDir::Type) const
    { size_t at = s.rfind(mark.s); if (at == std::string::npos) return false;
      if (left) *left = s.substr(0, at);
      if (right) *right = s.substr(at + mark.s.size()); return true; }
    FString operator+(const char* x) const { return s + x; }
    bool operator<(const FString& o) const { return s < o.s; }
};
struct FName { std::string s; bool operator<(const FName& o) const { return s < o.s; } };
template <class K, class V> struct TMap {
    struct Pair { K Key; V Value; };
    std::vector<Pair> all;
    void Add(K k, V v) { all.push_back({k, v}); }
    const V* Find(const K& k) const { for (auto& p : all) if (p.Key.s == k.s) return &p.Value; return nullptr; }
    auto begin() const { return all.begin(); }
    auto end() const { return all.end(); }
};
template <class T> struct TArray : std::vector<T> { int Num() const { return static_cast<int>(this->size()); } };
template <class T> struct TSharedPtr : std::shared_ptr<T> {
    using std::shared_ptr<T>::shared_ptr;
    TSharedPtr(std::shared_ptr<T> p = nullptr) : std::shared_ptr<T>(p) {}
    bool IsValid() const { return this->get() != nullptr; }
};
template <class T> struct TWeakObjectPtr { T* p; explicit TWeakObjectPtr(T* x) : p(x) {} bool IsValid() const { return p; } T* operator->() const { return p; } };
struct FRotator {
    double Pitch, Yaw, Roll;
    FRotator(double p, double y, double r) : Pitch(p), Yaw(y), Roll(r) {}
    static const FRotator ZeroRotator;
};
inline const FRotator FRotator::ZeroRotator{0, 0, 0};

struct FJsonValue { double n; double AsNumber() const { return n; } };
struct FJsonObject {
    TMap<FString, TSharedPtr<FJsonValue>> Values;
    std::map<std::string, TSharedPtr<FJsonObject>> objects;
    std::map<std::string, TArray<TSharedPtr<FJsonValue>>> arrays;
    bool TryGetObjectField(const char* k, const TSharedPtr<FJsonObject>*& out) const
    { auto it = objects.find(k); if (it == objects.end()) return false; out = &it->second; return true; }
    bool TryGetArrayField(const char* k, const TArray<TSharedPtr<FJsonValue>>*& out) const
    { auto it = arrays.find(k); if (it == arrays.end()) return false; out = &it->second; return true; }
};
template <class T = char> struct TJsonReaderFactory { static std::string Create(const FString& f) { return f.s; } };
struct FJsonSerializer {  // reads the server's own spelling only
    static bool Deserialize(const std::string& t, TSharedPtr<FJsonObject>& out) {
        if (t.empty() || t[0] != '{') return false;
        auto made = std::make_shared<FJsonObject>();
        for (std::string set : {"arkit", "visemes"}) {
            size_t at = t.find("\"" + set + "\": {");
            if (at == std::string::npos) continue;
            auto inner = std::make_shared<FJsonObject>();
            size_t end = t.find('}', at);
            at = t.find('{', at);
            while ((at = t.find('"', at + 1)) < end) {
                size_t close = t.find('"', at + 1);
                auto value = std::make_shared<FJsonValue>();
                value->n = atof(t.c_str() + close + 2);
                inner->Values.Add(FString(t.substr(at + 1, close - at - 1)), TSharedPtr<FJsonValue>(value));
                at = close;
            }
            made->objects[set] = TSharedPtr<FJsonObject>(inner);
        }
        size_t at = t.find("\"head\": [");
        if (at != std::string::npos) {
            double a, b, c;
            sscanf(t.c_str() + at, "\"head\": [%lf, %lf, %lf]", &a, &b, &c);
            for (double one : {a, b, c}) { auto v = std::make_shared<FJsonValue>(); v->n = one; made->arrays["head"].push_back(TSharedPtr<FJsonValue>(v)); }
        }
        out = TSharedPtr<FJsonObject>(made);
        return true;
    }
};

template <class... A> struct Event {
    std::vector<std::function<void(A...)>> all;
    template <class F> void AddLambda(F f) { all.push_back(f); }
    void Clear() { all.clear(); }
    void Tell(A... a) { for (auto& f : all) f(a...); }
};
struct IWebSocket {
    Event<const FString&> message; Event<int32, const FString&, bool> closed; Event<const FString&> error;
    Event<const FString&>& OnMessage() { return message; }
    Event<int32, const FString&, bool>& OnClosed() { return closed; }
    Event<const FString&>& OnConnectionError() { return error; }
    void Connect(); void Close() {}
};
struct FWebSocketsModule {
    static FWebSocketsModule& Get() { static FWebSocketsModule m; return m; }
    TSharedPtr<IWebSocket> CreateWebSocket(const FString&) { return TSharedPtr<IWebSocket>(std::make_shared<IWebSocket>()); }
};
struct FModuleManager { template <class T> static void LoadModuleChecked(const char*) {} };
inline IWebSocket* connected = nullptr;
inline int connections = 0;
inline void IWebSocket::Connect() { connected = this; ++connections; }

struct UMorphTarget { std::string name; FString GetName() { return FString(name); } FName GetFName() { return FName{name}; } };
struct USkeletalMesh { std::vector<UMorphTarget*> shapes; std::vector<UMorphTarget*>& GetMorphTargets() { return shapes; } };
struct USkeletalMeshComponent {
    USkeletalMesh* mesh; std::map<std::string, float> weights;
    USkeletalMesh* GetSkeletalMeshAsset() { return mesh; }
    void SetMorphTarget(FName n, float w) { weights[n.s] = w; }
};
struct AActor { USkeletalMeshComponent* face; template <class T> T* FindComponentByClass() { return face; } };
struct EEndPlayReason { enum Type { Destroyed }; };
enum ELevelTick { LEVELTICK_All };
struct FActorComponentTickFunction { bool bCanEverTick; };
struct UActorComponent {
    FActorComponentTickFunction PrimaryComponentTick; AActor* owner;
    AActor* GetOwner() { return owner; }
    virtual void BeginPlay() {}
    virtual void EndPlay(const EEndPlayReason::Type) {}
    virtual void TickComponent(float, ELevelTick, FActorComponentTickFunction*) {}
    virtual ~UActorComponent() = default;
};
